// Introspection: frames, links, authorities and counters. Of a tree in another process, frames and
// links.
#include <algorithm>

#include "bindings/reads/budget.hpp"
#include "records/versions.hpp"

namespace ztf {

namespace {

// The id of a frame that must exist.
template <class AnyTree>
FrameId known(const AnyTree& tree, nb::handle name) {
  const std::string_view text = frame_name_of(name, "frame");
  const FrameId id = tree.find(text);
  if (id == 0) raise(unknown_frame(tree, text));
  return id;
}

template <class AnyTree>
FrameInfo info_holding_gil(const AnyTree& tree, FrameId id) {
  const GilReleasedOnWait released;
  return tree.info(id);
}

template <class AnyTree>
nb::object name_or_none(const AnyTree& tree, FrameId id) {
  if (id == 0) return nb::none();
  return str_of(tree.name(id));
}

template <class AnyTree>
nb::list frames(const AnyTree& tree) {
  nb::list out;
  for (FrameId id = 1, n = tree.size(); id <= n; ++id)
    if (!tree.removed(id)) out.append(name_or_none(tree, id));
  if constexpr (std::is_same_v<AnyTree, SharedTree>) tree.check_lease();
  return out;
}

// (names, after of the next page or None): the frames whose ids are above `after`, at most `most`,
// or with `whole` no names if there are more than `most`. An id stays with a name until the frame
// is removed, so a frame that exists all the time is on one page exactly.
nb::tuple frames_page(const Tree& tree, std::uint64_t after, std::uint64_t most, bool whole,
                      Budget& budget) {
  nb::list out;
  std::uint64_t bytes = 0;
  const FrameId n = tree.size();
  auto id = static_cast<FrameId>(std::min<std::uint64_t>(after, n));
  if (whole && n - id > most) {  // counting costs a hundredth of listing in vain
    std::uint64_t count = 0;
    for (FrameId next = id; next < n && count <= most;) count += tree.removed(++next) ? 0 : 1;
    if (count > most) return nb::make_tuple(out, nb::int_(id));
  }
  while (id < n && out.size() < most) {
    if (tree.removed(++id)) continue;
    const std::string name = tree.name(id);
    bytes += name.size() + 5;
    if (bytes > budget.reply_bytes.left()) budget.reply_bytes.exhausted();
    out.append(str_of(name));
  }
  while (id < n && tree.removed(id + 1)) ++id;
  return nb::make_tuple(out, id < n ? nb::object(nb::int_(id)) : nb::none());
}

template <class AnyTree>
nb::object last_change(const AnyTree& tree, const FrameInfo& info) {
  using Change = FrameEvents::Change;
  if (info.change == Change::none) return nb::none();
  nb::dict out;
  out["kind"] = info.change == Change::reparented ? "reparented"
                : info.change == Change::switched ? "switched"
                                                  : "authority";
  out["stamp_ns"] = info.change_stamp;
  out["authority"] = str_of(tree.authority(info.change_authority));
  out["parent_before"] = name_or_none(tree, info.parent_before);
  out["static_before"] = info.static_before;
  out["authority_before"] = str_of(tree.authority(info.authority_before));
  const Pose& pose = info.pose_before;
  out["pose_before"] = nb::make_tuple(pose.x, pose.y, pose.z, pose.qx, pose.qy, pose.qz, pose.qw);
  return out;
}

template <class T>
T load(const std::atomic<T>& counter) {
  return counter.load(std::memory_order_relaxed);
}

// The last replacement of a static value; None if there was none.
template <class AnyTree>
nb::object last_replacement(const AnyTree& tree, const FrameEvents& events) {
  if (load(events.replaced_at_ns) == 0) return nb::none();
  nb::dict out;
  out["count"] = load(events.replaced);
  out["at_ns"] = load(events.replaced_at_ns);
  out["shift_m"] = load(events.replaced_m);
  out["turn_rad"] = load(events.replaced_rad);
  out["authority_before"] = str_of(tree.authority(load(events.replaced_authority)));
  return out;
}

// The last time that a history was cleared because time was set back; None if it never was.
nb::object last_time_jump(const FrameEvents& events) {
  if (load(events.jumped_at_ns) == 0) return nb::none();
  nb::dict out;
  out["at_ns"] = load(events.jumped_at_ns);
  out["newest_stamp_ns"] = load(events.jumped_from);
  return out;
}

// The fields of zenoh_tf.FrameInfo.
template <class AnyTree>
nb::dict record_of(const AnyTree& tree, nb::object name, FrameId id, const FrameInfo& info) {
  const FrameEvents& events = tree.events(id);
  const bool has_data = info.parent != 0;
  const auto stamp = [&](Stamp value) {
    return has_data ? nb::object(nb::int_(value)) : nb::none();
  };
  nb::dict out;
  out["name"] = name;
  out["parent"] = name_or_none(tree, info.parent);
  out["authority"] = str_of(tree.authority(info.authority));
  out["static"] = has_data && info.is_static;
  out["samples"] = has_data ? (info.is_static ? 1 : info.samples) : 0;
  out["oldest_stamp_ns"] = stamp(info.is_static ? info.newest : info.oldest);
  out["newest_stamp_ns"] = stamp(info.newest);
  out["version"] = info.version & kServerVersion;
  out["rewritten"] = load(events.rewritten);
  out["dropped"] = load(events.dropped);
  out["evicted"] = info.evicted;
  out["reparented"] = load(events.reparented);
  out["switched"] = load(events.switched);
  out["authority_changes"] = load(events.authority_changes);
  out["time_jumps"] = load(events.time_jumps);
  out["late_failures"] = load(events.late_failures);
  out["late_waits"] = load(events.late_waits);
  out["late_ns"] = load(events.late_ns);
  out["last_change"] = last_change(tree, info);
  out["last_replacement"] = last_replacement(tree, events);
  out["last_time_jump"] = last_time_jump(events);
  return out;
}

template <class AnyTree>
nb::dict read_frame_record(const AnyTree& tree, nb::handle name) {
  const FrameId id = known(tree, name);
  return record_of(tree, nb::borrow(name), id, info_holding_gil(tree, id));
}

template <class AnyTree>
nb::dict frame_record(const AnyTree& tree, nb::handle name) {
  return tree.read_names([&] { return read_frame_record(tree, name); });
}

// The records of the frames from both up to their roots, each once, as of one instant. Unknown
// frames have none. The parents are those at the stamp, if the links have data there.
template <class AnyTree>
nb::list ancestor_records(const AnyTree& tree, nb::handle target, nb::handle source,
                          nb::handle stamp) {
  NamedQuery query = query_of(Op::at, target, source);
  query.stamp = stamp_of(stamp, "stamp_ns");
  return tree.read_names([&] {
    query.find_ids(tree);
    const FrameId starts[] = {query.target, query.source};
    std::vector<NamedInfo> found;
    {
      const GilReleasedOnWait released;
      found = tree.ancestors(starts, query.stamp);
    }
    nb::list out;
    for (const NamedInfo& each : found)
      out.append(record_of(tree, name_or_none(tree, each.id), each.id, each.info));
    return out;
  });
}

// The fields of zenoh_tf.AuthorityInfo, in the order of their ids.
nb::list authority_records(const Tree& tree) {
  const AuthorityId n = tree.authorities();
  std::vector<std::uint32_t> frames(n + 1);
  {
    const GilReleased released;
    for (FrameId id = 1, size = tree.size(); id <= size; ++id) {
      const FrameInfo info = tree.info(id);
      if (info.parent != 0 && info.authority <= n) ++frames[info.authority];
    }
  }
  nb::list out;
  for (AuthorityId id = 1; id <= n; ++id) {
    if (tree.freed(id)) continue;
    const AuthorityCounts counts = tree.authority_counts(id);
    nb::dict record;
    record["name"] = str_of(tree.authority(id));
    record["frames"] = frames[id];
    record["commits"] = counts.commits;
    record["stored"] = counts.stored;
    record["dropped"] = counts.dropped;
    record["rewritten"] = counts.rewritten;
    record["conflicts"] = counts.conflicts;
    out.append(record);
  }
  return out;
}

// The links from the frames to their roots, by the newest parents; unknown frames have none.
std::uint64_t links(const Tree& tree, nb::handle frames) {
  std::uint64_t total = 0;
  for (const nb::handle name : tuple_of(frames)) {
    const std::string_view text = text_of(name, "frame");
    const GilReleasedOnWait released;
    std::uint32_t depth = 0;
    for (FrameId id = tree.find(text); id != 0 && depth <= tree.options().max_path(); ++depth)
      id = tree.parent(id, kNoStamp);
    total += depth;
  }
  return total;
}

template <class AnyTree>
nb::object parent(const AnyTree& tree, nb::handle frame, nb::handle stamp) {
  const Stamp at = stamp_of(stamp, "stamp_ns");
  return tree.read_names([&] {
    const FrameId id = known(tree, frame);
    FrameId found;
    {
      const GilReleasedOnWait released;
      found = tree.parent(id, at);
    }
    return name_or_none(tree, found);
  });
}

template <class AnyTree>
std::vector<std::string> chain_of(const AnyTree& tree, nb::handle target, nb::handle source,
                                  nb::handle stamp) {
  NamedQuery query = query_of(Op::at, target, source);
  query.stamp = stamp_of(stamp, "stamp_ns");
  std::vector<std::string> names;
  Failure failure;
  {
    const GilReleasedOnWait released;
    failure = chain(tree, query, names);
  }
  if (failure.code != Code::ok) raise(lookup_error(tree, failure, query));
  return names;
}

nb::dict stats(const Tree& tree) {
  std::optional<GilReleased> released(std::in_place);
  const TreeTotals totals = tree.totals();
  released.reset();
  nb::dict out;
  out["frames"] = totals.frames;
  out["static_links"] = totals.static_links;
  out["samples"] = totals.samples;
  out["commits"] = tree.commits();
  out["waiters"] = tree.wait_list().size();
  out["rewritten"] = totals.rewritten;
  out["dropped"] = totals.dropped;
  out["evicted"] = totals.evicted;
  out["time_jumps"] = tree.time_jumps();
  out["memory_bytes"] = tree.memory_bytes();
  out["from_future"] = tree.from_future();
  return out;
}

// What happened since the last call: maps, and how many events found no room.
nb::tuple take_events(Tree& tree) {
  using Kind = TreeEvent::Kind;
  const auto [events, lost] = [&] {
    const GilReleasedOnWait released;
    return tree.take_events();
  }();
  const auto stamp = [](Stamp value) {
    return value == kNoStamp ? nb::none() : nb::object(nb::int_(value));
  };
  // An authority of a commit that was rejected may have no name.
  const auto authority = [&](AuthorityId id) {
    return str_of(id <= tree.authorities() ? tree.authority(id) : std::string_view());
  };
  const auto name_or_none = [](const std::string& name) {
    return name.empty() ? nb::none() : nb::object(str_of(name));
  };
  nb::list out;
  for (const auto& [event, frame, parent, parent_before] : events) {
    nb::dict record;
    record["kind"] = event.kind == Kind::late        ? "late"
                     : event.kind == Kind::time_jump ? "time_jump"
                     : event.kind == Kind::conflict  ? "conflict"
                                                     : "reparented";
    record["frame"] = name_or_none(frame);
    record["authority"] = authority(event.authority);
    record["authority_before"] = authority(event.authority_before);
    record["parent"] = name_or_none(parent);
    record["parent_before"] = name_or_none(parent_before);
    record["stamp_ns"] = stamp(event.stamp);
    record["newest_stamp_ns"] = stamp(event.newest);
    record["count"] = event.count;
    out.append(record);
  }
  return nb::make_tuple(out, lost);
}

}  // namespace

template <class T>
void bind_introspection(nb::class_<T>& tree) {
  tree.def("frames", method<&frames<T>>, ZTF_DOC(Reads_frames))
      .def("parent", method<&parent<T>>, ZTF_DOC(Reads_parent), name_arg("frame"),
           nb::arg("stamp_ns").none() = nb::none())
      .def("chain", method<&chain_of<T>>, ZTF_DOC(Reads_chain), name_arg("target"),
           name_arg("source"), nb::arg("stamp_ns").none() = nb::none())
      .def("_startup_ns",
           [](const T& t) {
             const Startup startup = t.startup();
             return startup.is_over() ? nb::object(nb::none())
                                      : nb::make_tuple(startup.elapsed_ns, startup.left_ns);
           })
      .def("_frame_record", method<&frame_record<T>>, name_arg("name"))
      .def("_ancestor_records", method<&ancestor_records<T>>, name_arg("target"),
           name_arg("source"), nb::arg("stamp_ns").none() = nb::none());
  if constexpr (std::is_same_v<T, Tree>)
    tree.def("stats", &stats, ZTF_DOC(Tree_stats))
        .def("_frames_page", &frames_page, nb::arg("after"), nb::arg("most"), nb::arg("whole"),
             nb::arg("budget"))
        .def("_frame_count", [](const Tree& t) { return t.size(); })
        .def("_links", &links, nb::arg("frames"))
        .def("_authority_records", &authority_records)
        .def("_take_events", &take_events);
}
template void bind_introspection(nb::class_<Tree>&);
template void bind_introspection(nb::class_<SharedTree>&);

}  // namespace ztf
