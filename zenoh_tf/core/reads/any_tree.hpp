// What is read alike from a tree of this process and from a mapped one of another.
//
// Thread safety: as a Reader's.
#pragma once

#include <vector>

#include "base/rejected.hpp"
#include "reads/frame_reads.hpp"
#include "reads/reader.hpp"

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
