// Tree: the base class of zenoh_tf.TransformTree.
//
// GIL: a lookup, and a commit of a few rows, keeps it, since releasing it would cost more than the
// work. If it waits for a frame or a mutex for more than some microseconds, it releases it. Waits
// for data and longer commits release it. No thread waits for the GIL while it holds a lock of the
// core, so there is no deadlock between the two.
#include <cmath>
#include <system_error>

#include "bindings/bindings.hpp"

namespace ztf {

namespace {

constexpr std::pair<std::string_view, Concurrency> kConcurrency[] = {
    {"optimistic", Concurrency::optimistic},
    {"2pl", Concurrency::two_phase},
    {"giant", Concurrency::giant},
};

constexpr std::int64_t kLeastMemory = 1 << 16;  // bytes
// A commit of at most so many rows takes less time than to release the GIL and to take it back.
constexpr std::size_t kFewRows = 4;

bool set(Tree& tree, const StampedTransform& s, std::string_view authority, bool is_static) {
  const std::string_view names[] = {text_of(s.parent_frame, "parent_frame"),
                                    text_of(s.child_frame, "child_frame")};
  const Row row{0, 1, s.stamp, s.pose};
  std::uint8_t stored = 0;
  commit(tree,
         {.names = names,
          .rows = {&row, 1},
          .authority = authority,
          .is_static = is_static,
          .drop_old = true},
         {&stored, 1});
  return stored != 0;
}

void set_all(Tree& tree, nb::handle stampeds, std::string_view authority, bool is_static) {
  const nb::tuple items = tuple_of(stampeds);  // keeps the names' texts alive
  std::vector<std::string_view> names;
  std::vector<Row> rows;
  names.reserve(items.size() * 2);
  rows.reserve(items.size());
  for_each_stamped(items, [&](const StampedTransform& s) {
    const auto at = static_cast<std::uint32_t>(names.size());
    names.push_back(text_of(s.parent_frame, "parent_frame"));
    names.push_back(text_of(s.child_frame, "child_frame"));
    rows.push_back({at, at + 1, s.stamp, s.pose});
  });
  std::vector<std::uint8_t> stored(rows.size());
  commit(tree, {.names = names, .rows = rows, .authority = authority, .is_static = is_static},
         stored);
}

// Runs a write without the interpreter lock.
template <class Write>
void run_released(Write write) {
  rejected_as_error([&] {
    const GilReleased released;
    write();
  });
}

void clear(Tree& tree, bool keep_static, std::int64_t expires_ns) {
  run_released([&] { tree.clear(keep_static, expires_ns); });
}

void reset(Tree& tree, std::int64_t expires_ns) {
  run_released([&] { tree.reset(expires_ns); });
}

void remove_frame(Tree& tree, nb::handle name, bool subtree, std::int64_t expires_ns) {
  const std::string_view text = frame_name_of(name, "name");
  rejected_as_error([&] {
    try {
      const GilReleased released;
      tree.remove_frame(text, subtree, expires_ns);
    } catch (Rejected& rejected) {
      if (rejected.code == Code::lookup) rejected.message += suggestion(tree, {text});
      throw;
    }
  });
}

std::uint32_t limit_of(std::int64_t value, std::int64_t least, std::int64_t most,
                       const char* field) {
  if (value < least || value > most)
    raise_invalid(std::string(field) + " must be from " + std::to_string(least) + " to " +
                      std::to_string(most) + ", not " + std::to_string(value),
                  field);
  return static_cast<std::uint32_t>(value);
}

Concurrency concurrency_of(std::string_view name) {
  for (const auto& [known, value] : kConcurrency)
    if (name == known) return value;
  raise_invalid("concurrency must be 'optimistic', '2pl' or 'giant', not " + quoted(name),
                "concurrency");
}

std::int64_t ns_of(double seconds) { return static_cast<std::int64_t>(seconds * 1e9); }

void construct(Tree* self, double cache_time_s, std::string_view concurrency,
               std::int64_t max_frames, std::int64_t max_samples_per_frame,
               std::int64_t max_name_bytes, std::int64_t max_depth, bool one_authority_per_frame,
               std::string_view time_jump, std::int64_t max_memory_bytes,
               std::uint64_t max_log_bytes, bool shared, std::string_view instance) {
  Options options;
  if (!(cache_time_s > 0 && cache_time_s <= 1e9))
    raise_invalid("cache_time_s must be above 0 and at most 1e9 seconds", "cache_time_s");
  options.cache_ns = static_cast<std::uint64_t>(std::llround(cache_time_s * 1e9));
  options.concurrency = concurrency_of(concurrency);
  options.max_frames = limit_of(max_frames, 2, std::int64_t{1} << 30, "max_frames");
  options.max_samples_per_frame =
      limit_of(max_samples_per_frame, 2, std::int64_t{1} << 30, "max_samples_per_frame");
  options.max_name_bytes = limit_of(max_name_bytes, 1, 65535, "max_name_bytes");
  options.max_depth = limit_of(max_depth, 0, std::int64_t{1} << 30, "max_depth");
  options.one_authority_per_frame = one_authority_per_frame;
  if (max_memory_bytes != 0 && max_memory_bytes < kLeastMemory)
    raise_invalid("max_memory_bytes must be 0 or at least " + std::to_string(kLeastMemory) +
                      ", not " + std::to_string(max_memory_bytes),
                  "max_memory_bytes");
  options.max_memory_bytes = static_cast<std::uint64_t>(max_memory_bytes);
  if (time_jump != "reject" && time_jump != "clear")
    raise_invalid("time_jump must be 'reject' or 'clear', not " + quoted(time_jump), "time_jump");
  options.clear_on_time_jump = time_jump == "clear";
  options.max_log_bytes = max_log_bytes;
  options.shared = shared;
  options.instance = instance;
  try {
    new (self) Tree(options);
  } catch (const std::system_error& error) {
    const nb::object type = nb::borrow(PyExc_OSError);
    raise(type(error.code().value(), error.what()));
  }
}

// "TransformTree(3 frames, cache_time_s=10.0, concurrency='optimistic')"
std::string repr_of_tree(nb::handle self) {
  const Tree& tree = nb::cast<const Tree&>(self);
  const Options& options = tree.options();
  std::size_t frames = 0;
  for (FrameId id = 1, n = tree.size(); id <= n; ++id) frames += !tree.removed(id);
  std::string_view concurrency;
  for (const auto& [name, value] : kConcurrency)
    if (value == options.concurrency) concurrency = name;
  const nb::float_ cache_time_s(static_cast<double>(options.cache_ns) / 1e9);
  return nb::cast<std::string>(self.type().attr("__name__")) + "(" + std::to_string(frames) +
         (frames == 1 ? " frame" : " frames") +
         ", cache_time_s=" + nb::cast<std::string>(nb::repr(cache_time_s)) +
         ", concurrency=" + quoted(concurrency) + ")";
}

void bind_writes(nb::class_<Tree>& tree) {
  tree.def("set_transform", &set, ZTF_DOC(Tree_set_transform), nb::arg("stamped"),
           nb::arg("authority") = "", nb::arg("static") = false)
      .def("set_transforms_xact", &set_all, ZTF_DOC(Tree_set_transforms_xact), nb::arg("stampeds"),
           nb::arg("authority") = "", nb::arg("static") = false)
      .def(
          "clear", [](Tree& t, bool keep_static) { clear(t, keep_static, kNeverExpires); },
          ZTF_DOC(Tree_clear), nb::arg("keep_static") = true)
      .def(
          "reset", [](Tree& t) { reset(t, kNeverExpires); }, ZTF_DOC(Tree_reset))
      .def(
          "remove_frame",
          [](Tree& t, nb::handle name, bool subtree) {
            remove_frame(t, name, subtree, kNeverExpires);
          },
          ZTF_DOC(Tree_remove_frame), name_arg("name"), nb::arg("subtree") = false)
      .def("_clear", &clear, nb::arg("keep_static"), nb::arg("expires_ns"))
      .def("_reset", &reset, nb::arg("expires_ns"))
      .def("_remove_frame", &remove_frame, name_arg("name"), nb::arg("subtree"),
           nb::arg("expires_ns"));
}

}  // namespace

void commit(Tree& tree, const CommitRequest& request, std::span<std::uint8_t> stored) {
  rejected_as_error([&] {
    if (request.rows.size() + request.read_names.size() > kFewRows) {
      const GilReleased released;
      tree.commit(request, stored);
    } else {
      const GilReleasedOnWait released;
      tree.commit(request, stored);
    }
  });
}

void bind_tree(nb::module_& m) {
  const Options defaults;
  nb::class_<Tree> tree(m, "Tree", nb::is_weak_referenceable(), docs::Tree.text);
  tree.def("__init__", &construct, nb::arg("cache_time_s") = 10.0,
           nb::arg("concurrency") = "optimistic", nb::kw_only(),
           nb::arg("max_frames") = defaults.max_frames,
           nb::arg("max_samples_per_frame") = defaults.max_samples_per_frame,
           nb::arg("max_name_bytes") = defaults.max_name_bytes,
           nb::arg("max_depth") = defaults.max_depth,
           nb::arg("one_authority_per_frame") = defaults.one_authority_per_frame,
           nb::arg("time_jump") = "reject", nb::arg("max_memory_bytes") = 0,
           nb::arg("max_log_bytes") = 0, nb::arg("_shared") = false, nb::arg("_instance") = "")
      .def("_region_fd", &Tree::descriptor)
      .def(
          "_begin_lease", [](Tree& t, double seconds) { t.begin_lease(ns_of(seconds)); },
          nb::arg("duration_s"))
      .def(
          "_begin_startup",
          [](Tree& t, std::int64_t elapsed_ns, std::int64_t left_ns) {
            t.begin_startup({elapsed_ns, left_ns});
          },
          nb::arg("elapsed_ns"), nb::arg("left_ns"))
      .def_prop_rw("_is_recorded", &Tree::is_recorded, &Tree::set_recorded)
      .def("__repr__", &repr_of_tree);
  bind_writes(tree);
  bind_commit(tree);
  bind_puts(m, tree);
  bind_reads(tree);
}

}  // namespace ztf
