// The rules of histories/history.hpp on one frame: inserting, pruning, finding.
#include "histories/insert.hpp"

#include <map>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "fixture.hpp"
#include "histories/four_samples.hpp"
#include "owned_memory.hpp"

using namespace ztf;
using Status = LinkLookup::Status;

namespace {

struct Sent {
  Stamp stamp;
  FrameId parent;
  bool operator==(const Sent&) const = default;
};

class History {
 public:
  explicit History(std::uint64_t cache_ns = 10, std::uint32_t max_samples = 1u << 16,
                   std::uint32_t first_index = 0)
      : frame(std::make_unique<Frame>()), limits{cache_ns, max_samples} {
    frame->first.store(first_index);
  }

  // Returns nothing for a sample that is too old: the tree decides that before it calls insert().
  std::optional<InsertResult> put(Stamp stamp, FrameId parent, double x = 0) {
    if (frame->count.load() > 0 && too_old(stamp, frame->latest.stamp.load(), limits.cache_ns))
      return std::nullopt;
    reserve(1);
    return insert(*frame, stamp, parent, at_x(x), limits);
  }
  // Makes room for that many more samples, as a commit's plan does.
  void reserve(std::uint32_t extra) {
    if (!needs_larger_ring(*frame, frame->count.load(), extra, limits)) return;
    PreparedRing prepared = grown_ring(*frame, extra, limits, *memory);
    publish_ring(*frame, prepared);
  }
  // Inserts all at once. Requires what merged_ring() requires.
  PreparedRing merge(const std::vector<Sent>& sent) {
    std::vector<Pose> poses;
    for (const Sent& s : sent) poses.push_back(at_x(static_cast<double>(s.stamp)));
    std::vector<NewSample> samples;
    for (std::size_t i = 0; i < sent.size(); ++i)
      samples.push_back({sent[i].stamp, sent[i].parent, &poses[i]});
    PreparedRing prepared = merged_ring(*frame, false, samples, limits, *memory);
    publish_ring(*frame, prepared);
    return prepared;
  }
  void fix(Stamp stamp, FrameId parent, double x) { set_static(*frame, stamp, parent, at_x(x)); }

  [[nodiscard]] LinkLookup at(Stamp stamp) const {
    SampleInterval unused;
    return find_link(*frame, frame->ring.load(), stamp, unused);
  }
  [[nodiscard]] double x(Stamp stamp) const {
    SampleInterval b;
    CHECK_EQ(find_link(*frame, frame->ring.load(), stamp, b).status, Status::ok);
    Double4 unused;
    return lane(interpolate(b, b, b, b, unused), 3).x;
  }
  [[nodiscard]] std::vector<Sent> newest_first() const {
    std::vector<Sent> all;
    const Ring ring = frame->ring.load();
    for (std::uint32_t i = frame->count.load(), first = frame->first.load(); i-- > 0;)
      all.push_back({ring.stamp(first + i), parent_at(*frame, ring, first + i)});
    return all;
  }

  std::unique_ptr<OwnedArena> memory = std::make_unique<OwnedArena>();
  std::unique_ptr<Frame> frame;
  HistoryLimits limits;
};

// The samples of a history in a std::map, and what a history of these samples must say.
struct Model {
  HistoryLimits limits;
  std::map<Stamp, std::pair<FrameId, double>> samples = {};
  std::uint32_t evicted = 0;

  std::optional<InsertResult> put(Stamp stamp, FrameId parent, double x) {
    if (!samples.empty() && too_old(stamp, samples.rbegin()->first, limits.cache_ns))
      return std::nullopt;
    const bool replaces = samples.contains(stamp);
    if (!replaces && samples.size() == limits.max_samples) {
      if (stamp < samples.begin()->first) return InsertResult::rejected;
      evicted += !too_old(samples.begin()->first, stamp, limits.cache_ns);
      samples.erase(samples.begin());
    }
    samples[stamp] = {parent, x};
    while (too_old(samples.begin()->first, samples.rbegin()->first, limits.cache_ns))
      samples.erase(samples.begin());
    return replaces ? InsertResult::replaced : InsertResult::added;
  }

  void check_samples(const History& h) const {
    const Stamp oldest = samples.begin()->first, newest = samples.rbegin()->first;
    CHECK_EQ(h.frame->evicted.load(), evicted);
    CHECK_EQ(h.frame->latest.stamp.load(), newest);
    CHECK_EQ(oldest_served_stamp(*h.frame), oldest);
    std::vector<Sent> newest_first;
    std::uint32_t changes = 0;
    for (auto it = samples.rbegin(); it != samples.rend(); ++it) {
      newest_first.push_back({it->first, it->second.first});
      changes += it != samples.rbegin() && it->second.first != std::prev(it)->second.first;
    }
    CHECK_EQ(h.frame->count.load(), samples.size());
    CHECK(h.newest_first() == newest_first);
    CHECK_EQ(h.frame->parent_changes.load(), changes);
    CHECK_EQ(h.frame->samples_per_ns.load(),
             changes ? 0 : mean_sample_rate(h.frame->count, oldest, newest));
  }

  void check_lookup(const History& h, Stamp asked) const {
    const LinkLookup place = h.at(asked);
    const auto after = samples.upper_bound(asked);
    if (samples.size() == 1 && samples.begin()->first != asked) {
      CHECK_EQ(place.status, Status::no_data);
    } else if (after == samples.begin()) {
      CHECK_EQ(place.status, Status::backward);
    } else if (after == samples.end() && samples.rbegin()->first != asked) {
      CHECK_EQ(place.status, Status::forward);
    } else {
      const auto& [stamp, sample] = *std::prev(after);
      double value = sample.second;
      if (after != samples.end() && after->second.first == sample.first)
        value += (after->second.second - value) * static_cast<double>(asked - stamp) /
                 static_cast<double>(after->first - stamp);
      CHECK_EQ(place.status, Status::ok);
      CHECK_EQ(place.parent, sample.first);
      CHECK_NEAR(h.x(asked), value, 1e-9);
    }
  }
};

}  // namespace

TEST(the_ends_of_time_are_times) {
  const Stamp first = kNoStamp + 1, last = std::numeric_limits<Stamp>::max();
  for (const auto& [from, to] : {std::pair{first, Stamp{0}}, std::pair{Stamp{0}, last}}) {
    History h(static_cast<std::uint64_t>(last));
    h.put(to, 1, 1);
    h.put(from, 1, -1);
    CHECK_NEAR(h.x(from / 2 + to / 2), 0, 1e-15);
    CHECK_EQ(h.x(from), -1);
    CHECK_EQ(h.x(to), 1);
  }
  CHECK(too_old(first, last, ~std::uint64_t{0} - 2));
  CHECK(!too_old(first, last, ~std::uint64_t{0} - 1));
  CHECK(!too_old(last, first, 0));
  History h(10);
  h.put(last, 1);
  CHECK(!h.put(first, 1));
}

// Compared with a std::map, with irregular stamps, and with ring indices that overflow.
TEST(any_history_is_that_of_a_sorted_map) {
  std::mt19937_64 generator(7);
  for (int round = 0; round < 60; ++round) {
    const std::uint64_t cache = round % 3 ? 3000 : std::uint64_t{1} << 62;
    const std::uint32_t max_samples =
        round % 4 ? 64 : 1 + static_cast<std::uint32_t>(round) / 4 % 7;
    History h(cache, max_samples, round % 2 ? 0xFFFFFFFFu - static_cast<std::uint32_t>(round) : 0);
    Model model{h.limits};
    Stamp now = 0;
    for (int i = 0; i < 300; ++i) {
      // Bursts, pauses over many magnitudes, and stragglers.
      now += static_cast<Stamp>(generator() % (1u << generator() % 12));
      Stamp stamp = now;
      if (generator() % 3 == 0) stamp -= static_cast<Stamp>(generator() % 4000);
      const auto parent = static_cast<FrameId>(1 + generator() % 8 / 7);
      const double x = static_cast<double>(generator() % 1000);
      CHECK(h.put(stamp, parent, x) == model.put(stamp, parent, x));
      model.check_samples(h);
      model.check_lookup(h, now + 50 - static_cast<Stamp>(generator() % 4000));
    }
  }
}

TEST(a_cursor_ignores_the_slots_of_a_ring_that_was_replaced) {
  History h(100);
  for (Stamp stamp = 0; stamp < 100; stamp += 10) h.put(stamp, 1);
  clear_history(*h.frame);  // the slots keep their samples
  for (const Stamp stamp : {0, 1, 2, 3, 80}) h.put(stamp, 1);
  HistoryCursor cursor(*h.frame, h.frame->ring.load(), true);
  h.reserve(12);                      // replaces the ring
  for (const Stamp time : {3, 55}) {  // 55 would also fit between two old samples
    SampleInterval found, expected;
    CHECK(cursor.find(time, found));
    CHECK_EQ(find_link(*h.frame, h.frame->ring.load(), time, expected).status, Status::ok);
    CHECK_EQ(found.older->stamp.load(), expected.older->stamp.load());
    CHECK_EQ(found.newer->stamp.load(), expected.newer->stamp.load());
  }
}

// Whatever the order, a merge leaves what inserting one by one leaves.
TEST(a_merge_equals_inserting_one_by_one) {
  std::mt19937 random(3);
  for (int round = 0; round < 500; ++round) {
    const std::uint64_t cache_ns = 5 + random() % 100;
    const std::uint32_t most = 2 + random() % 40, parents = 1 + random() % 3;
    History one(cache_ns, most, random()), all(cache_ns, most, random());
    for (int batch = 0; batch < 4; ++batch) {
      std::vector<Sent> sent;
      for (std::size_t n = 1 + random() % 30; n > 0; --n)
        sent.push_back({static_cast<Stamp>(batch * 20 + random() % 60),
                        static_cast<FrameId>(1 + random() % parents)});
      std::stable_sort(sent.begin(), sent.end(),
                       [](const Sent& a, const Sent& b) { return a.stamp < b.stamp; });
      // The tree drops these before it inserts anything.
      const Frame& frame = *one.frame;
      const bool is_full = frame.count.load() == most;
      const Stamp oldest = oldest_served_stamp(frame);
      Stamp newest = frame.latest.stamp.load();
      bool has_samples = frame.count.load() > 0;
      std::erase_if(sent, [&](const Sent& s) {
        if (has_samples && too_old(s.stamp, newest, cache_ns)) return true;
        if (is_full && s.stamp < oldest) return true;
        newest = has_samples ? std::max(newest, s.stamp) : s.stamp;
        has_samples = true;
        return false;
      });
      if (sent.empty()) continue;
      std::uint32_t replaced = 0;
      for (const Sent& s : sent)
        replaced +=
            one.put(s.stamp, s.parent, static_cast<double>(s.stamp)) == InsertResult::replaced;
      CHECK_EQ(all.merge(sent).rewritten, replaced);
      CHECK(all.newest_first() == one.newest_first());
      const Frame &a = *all.frame, &b = *one.frame;
      CHECK_EQ(a.latest.stamp.load(), b.latest.stamp.load());
      CHECK_EQ(a.latest.pose[0], b.latest.pose[0]);
      CHECK_EQ(a.parent.load(), b.parent.load());
      CHECK_EQ(a.oldest_stamp.load(), b.oldest_stamp.load());
      CHECK_EQ(a.parent_changes.load(), b.parent_changes.load());
      CHECK_EQ(a.samples_per_ns.load(), b.samples_per_ns.load());
      CHECK_EQ(a.evicted.load(), b.evicted.load());
      for (const Sent& s : all.newest_first())
        CHECK_EQ(all.x(s.stamp), static_cast<double>(s.stamp));
    }
  }
}

TEST(what_the_cache_time_prunes_is_not_evicted) {
  for (const bool merges : {false, true}) {
    History h(5, 3);
    for (const Stamp stamp : {1, 2, 4}) h.put(stamp, 1);
    const auto send = [&](Stamp stamp) {
      merges ? (void)h.merge({{stamp, 1}}) : (void)h.put(stamp, 1);
    };
    send(7);  // prunes the first one
    CHECK_EQ(h.frame->evicted.load(), 0u);
    send(6);  // evicts the second one
    CHECK_EQ(h.frame->evicted.load(), 1u);
    CHECK_EQ(h.frame->count.load(), 3u);
  }
}
