// What is read alike from a tree of this process and from a mapped one of another.
//
// Thread safety: as a Reader's. What the functions of one frame return is valid only if the frame's
// version has not changed meanwhile.
#pragma once

#include <vector>

#include "base/rejected.hpp"
#include "reads/reader.hpp"
#include "records/frame_info.hpp"

namespace ztf {

// Answers all queries. Returns false if the transaction must be retried. Throws Rejected if more
// than `max_reads` frames are read, and were the tree's state at one instant: a torn walk may read
// more.
template <class AnyReader>
bool answer_all(AnyReader& reader, std::span<const Query> queries, std::span<Answer> answers,
                const ReadSet& reads, std::size_t max_reads) {
  for (std::size_t i = 0; i < queries.size(); ++i) {
    if (!reader.answer(queries[i], answers[i])) return false;
    if (reads.size() > max_reads) [[unlikely]] {
      if (!reader.is_valid()) return false;
      throw Rejected{.code = Code::limit, .message = "the lookup reads too many frames"};
    }
  }
  return true;
}

// Returns a frame's parent at a time, or of the newest sample for kNoStamp; 0 if there is none.
template <class Access>
FrameId parent_of(const Access& access, const Frame& frame, Stamp stamp) noexcept {
  SampleInterval interval;
  const LinkLookup link = stamp == kNoStamp ? SelectLatest{}(access, frame, interval)
                                            : SelectAt{stamp}(access, frame, interval);
  return link.status == LinkLookup::Status::ok ? link.parent : FrameId{0};
}

inline FrameInfo info_of(const Frame& frame, const FrameEvents& events, Version version) noexcept {
  const auto acquire = std::memory_order_acquire;
  FrameInfo info;
  info.version = version;
  info.parent = frame.parent.load(acquire);
  info.authority = frame.authority.load(acquire);
  info.is_static = frame.is_static.load(acquire);
  info.samples = frame.count.load(acquire);
  info.evicted = frame.evicted.load(acquire);
  info.oldest = oldest_served_stamp(frame);
  info.newest = frame.latest.stamp.load(acquire);
  info.change = events.change.load(acquire);
  info.change_stamp = events.change_stamp.load(acquire);
  info.change_authority = events.change_authority.load(acquire);
  info.parent_before = events.parent_before.load(acquire);
  info.static_before = events.static_before.load(acquire);
  return info;
}

// Lists the frames from each start up to its root with what is known of them, each once. A frame's
// parent is that of its link at `stamp`, or of the newest one (Reader::visit_ancestors).
template <class AnyReader>
bool list_ancestors(AnyReader& reader, std::span<const FrameId> starts, Stamp stamp,
                    const FrameEvents* events, std::vector<NamedInfo>& out) {
  out.clear();
  return reader.visit_ancestors(
      starts, stamp, [&](FrameId id, const Frame& frame, FrameId parent, Version version) {
        out.push_back({id, info_of(frame, events[id], version)});
        out.back().info.parent = parent;
      });
}

}  // namespace ztf
