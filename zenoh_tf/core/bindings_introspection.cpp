// What the tree says about itself.
#include "bindings.hpp"

namespace ztf {

namespace {

FrameId known(const Tree& tree, nb::handle name) {
  const FrameId id = frame_of(tree, name, "frame");
  if (id == 0) {
    nb::dict facts;
    facts["frame"] = name;
    raise(make_error(Code::lookup, "frame '" + std::string(text_of(name, "frame")) + "' does not exist",
                     facts));
  }
  return id;
}

nb::object name_or_none(const Tree& tree, FrameId id) {
  if (id == 0) return nb::none();
  const std::string_view name = tree.name(id);
  return nb::str(name.data(), name.size());
}

nb::list frames(const Tree& tree) {
  nb::list out;
  for (FrameId id = 1, n = tree.size(); id <= n; ++id) out.append(name_or_none(tree, id));
  return out;
}

nb::dict frame_record(const Tree& tree, nb::handle name) {
  const FrameId id = known(tree, name);
  const FrameInfo info = tree.info(id);
  const FrameCounters& counters = tree.counters(id);
  const auto count = [](const std::atomic<std::uint32_t>& c) { return c.load(std::memory_order_relaxed); };
  const bool has_data = info.parent != 0;
  const std::string_view authority = tree.authority(info.authority);
  nb::dict out;
  out["name"] = name;
  out["parent"] = name_or_none(tree, info.parent);
  out["authority"] = nb::str(authority.data(), authority.size());
  out["static"] = has_data && info.is_static;
  out["samples"] = has_data ? (info.is_static ? 1 : info.samples) : 0;
  out["oldest_stamp_ns"] = has_data ? nb::object(nb::int_(info.is_static ? info.newest : info.oldest)) : nb::none();
  out["newest_stamp_ns"] = has_data ? nb::object(nb::int_(info.newest)) : nb::none();
  out["version"] = info.version;
  out["rewritten"] = count(counters.rewritten);
  out["dropped"] = count(counters.dropped);
  out["evicted"] = count(counters.evicted);
  out["reparented"] = count(counters.reparented);
  out["switched"] = count(counters.switched);
  out["authority_changes"] = count(counters.authority_changes);
  return out;
}

nb::list chain(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp) {
  Query query = query_of(tree, Op::at, target, source);
  query.stamp = stamp_of(stamp, "stamp_ns");
  std::vector<FrameId> ids;
  const Failure failure = tree.chain(query, ids);
  if (failure.code != Code::ok) raise(make_error(tree, failure, target, source));
  nb::list out;
  for (const FrameId id : ids) out.append(name_or_none(tree, id));
  return out;
}

nb::dict stats(const Tree& tree) {
  std::uint64_t rewritten = 0, dropped = 0, evicted = 0, samples = 0, statics = 0;
  for (FrameId id = 1, n = tree.size(); id <= n; ++id) {
    const FrameInfo info = tree.info(id);
    const FrameCounters& counters = tree.counters(id);
    if (info.parent != 0 && info.is_static)
      ++statics;
    else if (info.parent != 0)
      samples += info.samples;
    rewritten += counters.rewritten.load(std::memory_order_relaxed);
    dropped += counters.dropped.load(std::memory_order_relaxed);
    evicted += counters.evicted.load(std::memory_order_relaxed);
  }
  nb::dict out;
  out["frames"] = tree.size();
  out["static_links"] = statics;
  out["samples"] = samples;
  out["commits"] = tree.commits();
  out["waiters"] = tree.room().size();
  out["rewritten"] = rewritten;
  out["dropped"] = dropped;
  out["evicted"] = evicted;
  return out;
}

}  // namespace

void bind_introspection(nb::class_<Tree>& tree) {
  tree.def("frames", &frames)
      .def("frame_record", &frame_record, nb::arg("name"))
      .def("parent",
           [](const Tree& tree, nb::handle frame, nb::handle stamp) {
             return name_or_none(tree, tree.parent(known(tree, frame), stamp_of(stamp, "stamp_ns")));
           },
           nb::arg("frame"), nb::arg("stamp_ns").none() = nb::none())
      .def("chain", &chain, nb::arg("target"), nb::arg("source"),
           nb::arg("stamp_ns").none() = nb::none())
      .def("stats", &stats);
}

}  // namespace ztf
