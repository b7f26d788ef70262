// The tree as a whole: its memory, and clearing it.
#include "tree.hpp"

#include <cstdlib>
#include <new>

#include "write_locks.hpp"

namespace ztf {

namespace {

// Zeroed memory that costs nothing until it is touched, aligned for Frame.
void* zeroed(std::size_t bytes) {
  void* memory = std::calloc(1, bytes + alignof(Frame));
  if (!memory) throw std::bad_alloc();
  return memory;
}

Frame* aligned(void* memory) noexcept {
  const auto address = reinterpret_cast<std::uintptr_t>(memory);
  return reinterpret_cast<Frame*>((address + alignof(Frame) - 1) & ~(alignof(Frame) - 1));
}

}  // namespace

void Tree::Freed::operator()(void* memory) const noexcept { std::free(memory); }

Tree::Tree(const Options& options)
    : options_(options),
      memory_(zeroed((std::size_t{options.max_frames} + 1) * sizeof(Frame))),
      frames_(aligned(memory_.get())),
      counters_memory_(static_cast<FrameCounters*>(
          zeroed((std::size_t{options.max_frames} + 1) * sizeof(FrameCounters)))),
      counters_(counters_memory_.get()),
      names_(options.max_frames),
      authorities_(options.max_authorities) {}

Tree::~Tree() {
  for (FrameId id = 1; id <= names_.size(); ++id) frames_[id].~Frame();
}

void Tree::clear(bool keep_static) {
  std::unique_lock giant(giant_, std::defer_lock);
  if (options_.concurrency == Concurrency::giant) giant.lock();
  const std::lock_guard topology(topology_);
  SmallVector<FrameId, 16> all;
  SmallVector<bool, 16> changed;
  for (FrameId id = 1; id <= names_.size(); ++id) all.push_back(id);
  (void)changed.reserve(all.size());  // halfway nothing may fail
  WriteLocks locks(*this, all);
  for (const FrameId id : all) {
    Frame& frame = frames_[id];
    const bool has_data = frame.parent.load(std::memory_order_relaxed) != 0;
    const bool drop = has_data && !(keep_static && frame.is_static.load(std::memory_order_relaxed));
    if (drop) forget(frame);
    changed.push_back(drop);
  }
  locks.release(changed);
  count_.add();
  for (std::size_t i = 0; room_.size() != 0 && i < all.size(); ++i)
    if (changed[i] && frames_[all[i]].waiters.load(std::memory_order_seq_cst) != 0)
      room_.changed(all[i], WaitingRoom::Change::other);
}

}  // namespace ztf
