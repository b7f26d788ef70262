// How a draft is made and published.
#include "histories/draft.hpp"

namespace ztf {

namespace {

template <class T>
void copy_word(std::atomic<T>& to, const std::atomic<T>& from) noexcept {
  to.store(from.load(std::memory_order_relaxed), std::memory_order_release);
}

// Copies all that says which samples a ring has, and the newest one.
void copy_history(Frame& to, const Frame& from) noexcept {
  store_latest(to, from.latest.stamp.load(std::memory_order_relaxed),
               from.parent.load(std::memory_order_relaxed), from.latest.pose.load());
  copy_word(to.is_static, from.is_static);
  copy_word(to.first, from.first);
  copy_word(to.count, from.count);
  copy_word(to.oldest_stamp, from.oldest_stamp);
  copy_word(to.samples_per_ns, from.samples_per_ns);
  copy_word(to.parent_changes, from.parent_changes);
  copy_word(to.evicted, from.evicted);
}

}  // namespace

HistoryDraft::HistoryDraft(const Frame& frame, const HistoryLimits& limits,
                           RingArena& memory) noexcept
    : limits_(limits), memory_(memory) {
  copy_history(record_, frame);
  record_.ring.store(frame.ring.load(std::memory_order_relaxed), std::memory_order_relaxed);
}

HistoryDraft::~HistoryDraft() {
  if (owns_ring_) record_.ring.load(std::memory_order_relaxed).give_back(memory_);
}

void HistoryDraft::store(std::span<const NewSample> samples) {
  if (samples.empty()) return;
  const auto relaxed = std::memory_order_relaxed;
  const auto count = static_cast<std::uint32_t>(samples.size());
  const bool is_sorted =
      std::is_sorted(samples.begin(), samples.end(),
                     [](const NewSample& a, const NewSample& b) { return a.stamp < b.stamp; });
  PreparedRing prepared{};
  if (is_sorted && count > 1 && record_.count.load(relaxed) == 0)
    prepared = merged_ring(record_, true, samples, limits_, memory_);
  else if (is_sorted)
    prepared = prepare_ring(
        record_, false, count, samples.front().stamp, [&] { return samples; }, limits_, memory_);
  // Samples that are not merged are stored into the draft's ring, which must be its own.
  const std::uint64_t kept = record_.count.load(relaxed);
  if (!prepared.ring && (!owns_ring_ || needs_larger_ring(record_, kept, count, limits_)))
    prepared = grown_ring(record_, count, limits_, memory_);
  const bool is_merged = prepared.is_merged;
  if (prepared.ring) use(prepared);
  if (is_merged) return;
  HistoryWriter history(record_, nullptr, limits_);
  for (const NewSample& sample : samples) history.store(sample.stamp, sample.parent, *sample.pose);
}

void HistoryDraft::forget_parent(FrameId parent) {
  if (record_.count.load(std::memory_order_relaxed) == 0) return;
  if (!owns_ring_) use(grown_ring(record_, 0, limits_, memory_));
  (void)forget_parents(record_, [&](FrameId id) { return id == parent; });
}

// Gives the draft a prepared ring.
void HistoryDraft::use(PreparedRing prepared) noexcept {
  publish_ring(record_, prepared);
  if (owns_ring_ && prepared.ring) prepared.ring.give_back(memory_);
  owns_ring_ = true;
}

Ring HistoryDraft::publish(Frame& frame) noexcept {
  copy_history(frame, record_);
  if (!owns_ring_) return {};
  const Ring before = frame.ring.load(std::memory_order_relaxed);
  frame.ring.store(record_.ring.load(std::memory_order_relaxed), std::memory_order_release);
  owns_ring_ = false;
  return before;
}

}  // namespace ztf
