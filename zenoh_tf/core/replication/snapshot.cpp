// How a snapshot's pieces are planned and read.
#include "replication/snapshot.hpp"

#include <algorithm>

namespace ztf {

namespace {

constexpr std::size_t kFrameBytes = 64;   // of a frame without samples in a message, roughly
constexpr std::size_t kSampleBytes = 72;  // of a sample

}  // namespace

SnapshotPlan SnapshotReader::plan(std::size_t piece_bytes) {
  SnapshotPlan plan{tree_.change_log->last_drawn(), false, {0}};
  {
    // A commit that adds or removes a name holds this mutex when it draws its number.
    const auto topology = lock_announced(tree_.topology);
    plan.ever_reparented = tree_.ever_reparented.load();
  }
  std::size_t bytes = 0;
  const FrameId last = tree_.names.size();
  for (FrameId id = 1; id <= last; ++id) {
    const std::uint32_t count = tree_.frames[id].count.load(std::memory_order_relaxed);
    bytes += kFrameBytes + kSampleBytes * std::min(count, tree_.options.max_samples_per_frame);
    if (bytes < piece_bytes) continue;
    plan.bounds.push_back(id);
    bytes = 0;
  }
  if (plan.bounds.back() != last || last == 0) plan.bounds.push_back(last);
  return plan;
}

SnapshotPiece SnapshotReader::read(FrameId after, FrameId last, std::size_t most_bytes) {
  return tree_.read_names([&] { return read_once(after, last, most_bytes); });
}

SnapshotPiece SnapshotReader::read_once(FrameId after, FrameId last, std::size_t most_bytes) {
  SnapshotPiece piece{last, {}};
  const FrameTable& frames = piece.frames;
  const FrameId end = std::min(last, tree_.names.size());
  for (FrameId id = after; id < end;) {
    add_frame(++id, piece.frames);
    if (frames.frame.size() * kFrameBytes + frames.stamp.size() * kSampleBytes < most_bytes)
      continue;
    piece.reached = id;
    break;
  }
  return piece;
}

void SnapshotReader::add_frame(FrameId id, FrameTable& frames) {
  copy_.read(tree_.frames[id], tree_.edits[id], [](std::uint32_t, auto&&) { return 0u; });
  // After the copy: a frame that was removed before it has no name now, or has come back since, and
  // then its creation is in the log.
  if (tree_.removed(id)) return;
  const auto name_of = [this](FrameId named) { return tree_.name(named); };
  const auto authority_of = [this](AuthorityId named) { return tree_.authority(named); };
  const auto samples = copy_.samples();
  frames.frame.push_back(frames.names.add(id, name_of));
  frames.version.push_back(copy_.version);
  frames.authority.push_back(frames.authorities.add(copy_.authority, authority_of));
  frames.count.push_back(static_cast<std::uint32_t>(samples.size()));
  frames.is_static.push_back(copy_.is_static);
  FrameId last = 0;  // mostly all samples have one parent
  std::uint32_t index = kNoParent;
  for (const auto& [stamp, parent, pose] : samples) {
    if (parent != last) {
      last = parent;
      index = parent == 0 ? kNoParent : frames.names.add(parent, name_of);
    }
    frames.stamp.push_back(stamp);
    frames.parent.push_back(index);
    frames.pose.push_back(pose);
  }
}

}  // namespace ztf
