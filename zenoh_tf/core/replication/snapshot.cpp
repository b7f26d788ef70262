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
  SnapshotPiece piece;
  piece.reached = last;
  names_.clear();
  authorities_.clear();
  const FrameId end = std::min(last, tree_.names.size());
  for (FrameId id = after; id < end;) {
    add_frame(++id, piece);
    if (piece.frame.size() * kFrameBytes + piece.stamp.size() * kSampleBytes < most_bytes) continue;
    piece.reached = id;
    break;
  }
  return piece;
}

// Copies a frame's state at one instant, with as many samples as there is room for.
SnapshotReader::FrameState SnapshotReader::copy(const Frame& frame) {
  const auto acquire = std::memory_order_acquire;
  return frame.version.read_consistent([&](Version version) noexcept {
    FrameState state{version,
                     frame.parent.load(acquire),
                     frame.authority.load(acquire),
                     frame.count.load(acquire),
                     frame.is_static.load(acquire),
                     true};
    if (state.is_static || state.count == 0) {
      state.count = state.is_static ? 1 : 0;
      samples_[0] = {frame.latest.stamp.load(acquire), state.parent, frame.latest.pose.load()};
      return state;
    }
    const Ring ring = frame.ring.load(acquire);
    const std::uint32_t first = frame.first.load(acquire);
    const bool has_parents = frame.parent_changes.load(acquire) != 0;
    state.fits = state.count <= samples_.size();
    if (!ring || !state.fits) return state;  // without a ring: a torn read
    for (std::uint32_t i = 0; i < state.count; ++i)
      samples_[i] = {ring.stamp(first + i), has_parents ? ring.parent(first + i) : state.parent,
                     ring.sample(first + i).pose.load()};
    return state;
  });
}

void SnapshotReader::add_frame(FrameId id, SnapshotPiece& piece) {
  const Frame& frame = tree_.frames[id];
  FrameState state{};
  do {
    const std::size_t room = frame.count.load(std::memory_order_acquire) + std::size_t{16};
    if (samples_.size() < room)
      samples_.resize(std::min<std::size_t>(room, tree_.options.max_samples_per_frame + 16));
    state = copy(frame);
  } while (!state.fits);
  // After the copy: a frame that was removed before it has no name now, or has come back since, and
  // then its creation is in the log.
  if (tree_.removed(id)) return;
  piece.frame.push_back(name_of(id, piece));
  piece.version.push_back(state.version);
  piece.authority.push_back(authority_of(state.authority, piece));
  piece.count.push_back(state.count);
  piece.is_static.push_back(state.is_static);
  for (std::uint32_t i = 0; i < state.count; ++i) {
    piece.stamp.push_back(samples_[i].stamp);
    piece.parent.push_back(samples_[i].parent == 0 ? kNoParent
                                                   : name_of(samples_[i].parent, piece));
    piece.pose.push_back(samples_[i].pose);
  }
}

std::uint32_t SnapshotReader::name_of(FrameId id, SnapshotPiece& piece) {
  const auto [at, is_new] = names_.try_emplace(id, static_cast<std::uint32_t>(piece.names.size()));
  if (is_new) piece.names.push_back(tree_.name(id));
  return at->second;
}

std::uint32_t SnapshotReader::authority_of(AuthorityId id, SnapshotPiece& piece) {
  const auto [at, is_new] =
      authorities_.try_emplace(id, static_cast<std::uint32_t>(piece.authorities.size()));
  if (is_new) piece.authorities.push_back(tree_.authority(id));
  return at->second;
}

}  // namespace ztf
