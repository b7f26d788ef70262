// decode_puts: the messages of many puts as TransformRows;
// Tree._commit_puts: commits many TransformRows, each as a transaction of its own.
//
// GIL: released once for all messages, and once for all commits. What is read meanwhile belongs to
// bytes and TransformRows, which nobody changes.
#include <new>

#include "bindings/commits/transform_rows.hpp"

namespace ztf {

namespace {

// TransformRows of each message, or None: it is of another form, or beyond a limit.
nb::list decode_puts(const nb::list& messages, std::size_t max_rows, std::size_t max_bytes) {
  const PutLimits limits{max_rows, max_bytes};
  const nb::tuple kept = tuple_of(messages);
  std::vector<std::string_view> data(kept.size());
  for (std::size_t i = 0; i < kept.size(); ++i)
    if (PyBytes_CheckExact(kept[i].ptr())) {
      const nb::bytes message = nb::borrow<nb::bytes>(kept[i]);
      data[i] = {message.c_str(), message.size()};
    }
  std::vector<std::optional<PutMessage>> puts(kept.size());
  {
    const GilReleased released;
    for (std::size_t i = 0; i < puts.size(); ++i) {
      try {
        puts[i] = parse_put(data[i], limits);
      } catch (const std::bad_alloc&) {  // the general decoder reports it
      }
    }
  }
  nb::list rows;
  for (std::size_t i = 0; i < puts.size(); ++i)
    rows.append(puts[i]
                    ? nb::cast(TransformRows(nb::borrow<nb::object>(kept[i]),
                                             std::move(puts[i]->names), std::move(puts[i]->rows)))
                    : nb::none());
  return rows;
}

// A put on its way into the tree.
struct PutCommit {
  CommitRequest request;
  std::span<std::uint8_t> stored;
  std::optional<Rejected> rejected;
  bool out_of_memory = false;
};

// Commits without the GIL. A put that is refused as a whole changes nothing, so the others are
// committed.
void commit_each(Tree& tree, std::vector<PutCommit>& puts) {
  const GilReleased released;
  for (PutCommit& put : puts) {
    try {
      tree.commit(put.request, put.stored);
    } catch (Rejected& rejected) {
      put.rejected = std::move(rejected);
    } catch (const std::bad_alloc&) {
      put.out_of_memory = true;
    }
  }
}

// None: all rows are stored. Bytes: what became of each row. Else why none is stored.
nb::object outcome_of(PutCommit& put) {
  if (put.rejected) return make_error(*put.rejected);
  if (put.out_of_memory) return make_memory_error();
  const auto is_stored = [](std::uint8_t result) { return result == RowResult::stored; };
  if (std::all_of(put.stored.begin(), put.stored.end(), is_stored)) return nb::none();
  return nb::bytes(reinterpret_cast<const char*>(put.stored.data()), put.stored.size());
}

nb::list commit_puts(Tree& tree, const nb::list& rows, const nb::list& authorities,
                     const nb::list& max_stamps, const std::optional<nb::list>& drop_strays) {
  const nb::tuple kept = tuple_of(rows), names = tuple_of(authorities);
  const nb::tuple latest = tuple_of(max_stamps);
  const nb::tuple strays = drop_strays ? tuple_of(*drop_strays) : nb::make_tuple();
  if (names.size() != kept.size() || latest.size() != kept.size() ||
      (drop_strays && strays.size() != kept.size()))
    raise_invalid("rows, authorities, max_stamps_ns and drop_strays must be equally long", "rows");
  std::vector<PutCommit> puts(kept.size());
  std::size_t total = 0;
  for (const nb::handle each : kept) total += nb::cast<const TransformRows&>(each).rows().size();
  std::vector<std::uint8_t> stored(total);
  std::span<std::uint8_t> unused(stored);
  for (std::size_t i = 0; i < kept.size(); ++i) {
    const auto& put_rows = nb::cast<const TransformRows&>(kept[i]);
    PutCommit& put = puts[i];
    put.request = {.names = put_rows.texts(),
                   .rows = put_rows.rows(),
                   .authority = text_of(names[i], "authority"),
                   .drop_old = true,
                   .drop_bad = true,
                   .drop_strays = !drop_strays || nb::cast<bool>(strays[i])};
    if (!latest[i].is_none()) put.request.max_stamp = nb::cast<Stamp>(latest[i]);
    put.stored = unused.first(put_rows.rows().size());
    unused = unused.subspan(put_rows.rows().size());
  }
  commit_each(tree, puts);
  nb::list outcomes;
  for (PutCommit& put : puts) outcomes.append(outcome_of(put));
  return outcomes;
}

}  // namespace

void bind_puts(nb::module_& m, nb::class_<Tree>& tree) {
  m.def("decode_puts", &decode_puts, nb::arg("messages"), nb::arg("max_rows"),
        nb::arg("max_decoded_bytes"));
  tree.def("_commit_puts", &commit_puts, nb::arg("rows"), nb::arg("authorities"),
           nb::arg("max_stamps_ns"), nb::arg("drop_strays").none() = nb::none());
}

}  // namespace ztf
