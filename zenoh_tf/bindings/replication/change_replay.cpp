// ChangeReplay: snapshots and changes of another tree are replayed into this one.
//
// GIL: replaying releases it.
#include "replication/change_replay.hpp"

#include "bindings/bindings.hpp"
#include "replication/message.hpp"

namespace ztf {

namespace {

class Replay {
 public:
  explicit Replay(Tree& tree) : tree_(tree), replay_(tree.state()) {
    if (tree.options().concurrency == Concurrency::giant)
      raise_invalid(
          "a tree of concurrency 'giant' cannot be a mirror: a replay does not take its "
          "mutex",
          "concurrency");
  }

  void apply(Seq last, const nb::bytes& message) {
    rejected_as_error([&, data = view_of(message)] {
      const GilReleased released;
      const auto received = parse_changes(data);
      check_replayable(received.columns, tree_.options());
      replay_.apply(received.columns, last);
    });
  }

  void load(const nb::bytes& message) {
    rejected_as_error([&, data = view_of(message)] {
      const GilReleased released;
      const auto received = parse_frames(data);
      check_replayable(received.columns, tree_.options());
      replay_.load(received.columns);
    });
  }

  void set_ever_reparented() { replay_.set_ever_reparented(); }

 private:
  Tree& tree_;
  ChangeReplay replay_;
};

// A message whose columns are read as arrays; its texts are views of it.
template <auto parse>
struct Unpacked {
  explicit Unpacked(nb::bytes data)
      : message(std::move(data)),
        received(rejected_as_error([&] { return parse(view_of(message)); })) {}

  Unpacked(const Unpacked&) = delete;
  Unpacked& operator=(const Unpacked&) = delete;

  nb::bytes message;
  const decltype(parse({})) received;
};

nb::tuple texts_of(std::span<const std::string_view> texts) {
  nb::list list;
  for (const std::string_view text : texts) list.append(str_of(text));
  return tuple_of(list);
}

// A view, which keeps the columns alive.
template <class T>
nb::object array_of(nb::handle self, std::span<const T> column) {
  using Number = std::conditional_t<std::is_enum_v<T>, std::uint8_t,
                                    std::conditional_t<std::is_same_v<T, Pose>, double, T>>;
  const std::size_t shape[] = {column.size(), sizeof(T) / sizeof(Number)};
  return nb::cast(
      nb::ndarray<nb::numpy, const Number>(column.data(), shape[1] == 1 ? 1 : 2, shape, self));
}

template <auto parse>
void bind_unpacked(nb::module_& m, const char* name) {
  using Message = Unpacked<parse>;
  auto type = nb::class_<Message>(m, name)
                  .def(nb::init<nb::bytes>(), nb::arg("message"))
                  .def_prop_ro("names", [](const Message& m) { return texts_of(m.received.names); })
                  .def_prop_ro("authorities",
                               [](const Message& m) { return texts_of(m.received.authorities); });
  using Columns = std::remove_cvref_t<decltype(Message::received.columns)>;
  Columns::each_column([&](const char* field, auto column) {
    type.def_prop_ro(field, [column](nb::handle self) {
      return array_of(self, nb::cast<const Message&>(self).received.columns.*column);
    });
  });
}

}  // namespace

void bind_change_replay(nb::module_& m) {
  nb::class_<Replay>(m, "ChangeReplay", "Makes a tree the mirror of another.")
      .def(nb::init<Tree&>(), nb::arg("tree"), nb::keep_alive<1, 2>())
      .def("apply", &Replay::apply, nb::arg("last"), nb::arg("changes"))
      .def("load", &Replay::load, nb::arg("frames"))
      .def("set_ever_reparented", &Replay::set_ever_reparented);
  bind_unpacked<parse_changes>(m, "Changes");
  bind_unpacked<parse_frames>(m, "Frames");
}

}  // namespace ztf
