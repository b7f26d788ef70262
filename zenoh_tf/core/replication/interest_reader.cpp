// How the frames on the paths are copied and sent. replication/interest_paths.cpp finds them.
#include "replication/interest_reader.hpp"

#include <algorithm>
#include <unordered_set>

#include "base/rejected.hpp"
#include "commits/write_locks.hpp"
#include "replication/snapshot.hpp"

namespace ztf {

namespace {

constexpr int kOptimisticReads = 32;
constexpr auto kAcquire = std::memory_order_acquire;
// Added to a frame's version it is above all that the frame will ever have.
constexpr Version kVersionBound = Version{1} << 40;

}  // namespace

// Collects changes with the names that they refer to.
class InterestReader::Rows {
 public:
  Rows(const TreeState& tree, ChangeRows& out) : tree_(tree), out_(out) {}

  std::uint32_t name(const std::string& text) {
    const auto [at, is_new] = texts_.try_emplace(text, size(out_.names));
    if (is_new) out_.names.push_back(text);
    return at->second;
  }
  std::uint32_t name(FrameId id) {
    const auto at = ids_.find(id);
    if (at != ids_.end()) return at->second;
    return ids_[id] = name(tree_.name(id));
  }
  void add(ChangeKind kind, std::uint32_t frame, Version version) {
    out_.kind.push_back(kind);
    out_.frame.push_back(frame);
    out_.version.push_back(version);
  }
  void add_sample(const Copy& copy, std::uint32_t frame, const CopiedSample& sample) {
    add(copy.is_static ? ChangeKind::static_link : ChangeKind::sample, frame, copy.version);
    out_.parent.push_back(sample.parent == 0 ? kNoParent : name(sample.parent));
    out_.authority.push_back(authority(copy.authority));
    out_.stamp.push_back(sample.stamp);
    out_.pose.push_back(sample.pose);
  }

 private:
  static std::uint32_t size(const std::vector<std::string>& list) {
    return static_cast<std::uint32_t>(list.size());
  }
  std::uint32_t authority(AuthorityId id) {
    const auto [at, is_new] = authorities_.try_emplace(id, size(out_.authorities));
    if (is_new) out_.authorities.push_back(tree_.authority(id));
    return at->second;
  }

  const TreeState& tree_;
  ChangeRows& out_;
  std::unordered_map<std::string, std::uint32_t> texts_;
  std::unordered_map<FrameId, std::uint32_t> ids_;
  std::unordered_map<AuthorityId, std::uint32_t> authorities_;
};

InterestReader::InterestReader(TreeState& tree, Pairs pairs, bool newest_only)
    : tree_(tree), pairs_(std::move(pairs)), newest_only_(newest_only) {}

bool InterestReader::has_changed() const {
  const std::lock_guard lock(mutex_);
  if (pairs_.empty() || refs_.empty()) return true;
  // A frame that is removed gets another version, too.
  for (const auto& [id, sent] : sent_)
    if (tree_.version(id) != sent.version) return true;
  for (const auto& [id, before] : watched_) {
    const Link now = read_link(id);
    if (now.parent != before.parent || now.has_several_parents ||
        now.is_removed != before.is_removed)
      return true;
  }
  for (std::size_t i = 0; i < refs_.size(); ++i)
    if (refs_[i].id == 0 &&
        tree_.names.find(i % 2 ? pairs_[i / 2].second : pairs_[i / 2].first) != 0)
      return true;
  return false;
}

InterestReader::Result InterestReader::read(bool with_all, std::size_t max_frames) {
  const std::lock_guard lock(mutex_);
  for (int attempt = 0; attempt < kOptimisticReads; ++attempt)
    if (std::optional<Result> result = try_read(with_all, max_frames)) return std::move(*result);
  return read_locked(with_all, max_frames);
}

std::optional<InterestReader::Result> InterestReader::try_read(bool with_all,
                                                               std::size_t max_frames) {
  // A commit with a number up to this one makes readers wait for its frames (WriteLocks). If it
  // adds names, it also holds the topology mutex, until the names can be found.
  seq_ = tree_.change_log->last_drawn();
  {
    const auto topology = lock_announced(tree_.topology);
  }
  begin_attempt();
  find_frames(max_frames);
  if (frames_.size() > max_frames) {
    if (!is_valid()) return std::nullopt;
    check_frames(max_frames);
  }
  copy_frames(with_all);
  Result result = make_result(with_all);  // before the comparison, which is for the names, too
  if (!is_valid()) return std::nullopt;
  // A mirror applies changes only under a number that is new to it. The last read returned all
  // commits up to its number, those in progress included, as above. So the new changes are of a
  // later commit. It drew its number before it stored anything: perhaps just after `seq_` was
  // loaded. A thread that sees its changes also sees its number, so the next attempt has a later
  // one. That may be another commit's; then this commit is sent early, and only once.
  if (!result.changes.kind.empty() && seq_ <= sent_seq_) return std::nullopt;
  keep_sent();
  return result;
}

// Holds the locks of all frames that it reads, so that they do not change. The topology mutex keeps
// links and names as they are.
InterestReader::Result InterestReader::read_locked(bool with_all, std::size_t max_frames) {
  const auto giant = lock_transaction(tree_);
  const auto topology = lock_announced(tree_.topology);
  begin_attempt();
  find_frames(kNoReadLimit);
  FrameList ascending;
  for (const FrameId id : frames_) ascending.push_back(id);
  std::sort(ascending.begin(), ascending.end());
  const WriteLocks locks(tree_, ascending, true);
  // None of these frames changes any more, so what is new has a number up to this one.
  seq_ = tree_.change_log->last_drawn();
  begin_attempt();
  find_frames(kNoReadLimit);
  check_frames(max_frames);
  copy_frames(with_all);
  Result result = make_result(with_all);
  keep_sent();
  return result;
}

void InterestReader::begin_attempt() {
  ids_freed_ = tree_.ids_freed.load(kAcquire);
  links_.clear();
  wanted_.clear();
  frames_.clear();
  reads_.clear();
  copies_.clear();
  removed_.clear();
  new_refs_.clear();
}

// Throws Rejected if the attempt has found more frames. Requires that what it has read is valid: a
// torn walk may find more.
void InterestReader::check_frames(std::size_t max_frames) const {
  if (frames_.size() <= max_frames) return;
  throw Rejected{.code = Code::limit,
                 .message = "the paths of the interest have more than " +
                            std::to_string(max_frames) + " frames",
                 .field = "interest_frames",
                 .limit = static_cast<std::int64_t>(max_frames),
                 .value = static_cast<std::int64_t>(frames_.size())};
}

void InterestReader::copy_frames(bool with_all) {
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const FrameId id = frames_[i];
    const auto at = sent_.find(id);
    const Sent* sent =
        at != sent_.end() && tree_.names.is_current(at->second.ref) ? &at->second : nullptr;
    if (sent && !with_all && sent->version == tree_.version(id)) continue;
    copies_.emplace_back().id = id;
    copy_frame(copies_.back(), sent, with_all);
  }
  ever_reparented_ = tree_.ever_reparented.load();
}

void InterestReader::copy_frame(Copy& copy, const Sent* sent, bool with_all) {
  const Frame& frame = tree_.frames[copy.id];
  copy.is_new = !sent;
  if (copy.is_new) {
    copy.name = tree_.name(copy.id);
    copy.ref = tree_.names.find_ref(copy.name);
  }
  std::vector<CopiedSample>& samples = copy.samples;
  std::size_t room = sent && !with_all ? 8 : 16;
  do {
    samples.resize(room);
    frame.version.read_consistent([&](Version version) noexcept {
      copy.version = version;
      copy.parent = frame.parent.load(kAcquire);
      copy.authority = frame.authority.load(kAcquire);
      copy.oldest = frame.oldest_stamp.load(kAcquire);
      copy.edits = tree_.edits[copy.id].load(kAcquire);
      copy.count = frame.count.load(kAcquire);
      copy.is_static = frame.is_static.load(kAcquire);
      copy.is_append = sent && copy.edits == sent->edits;
      copy.first_new = 0;
      copy.fits = true;
      if (copy.is_static || copy.count == 0) {
        copy.count = copy.is_static ? 1 : 0;
        samples[0] = {frame.latest.stamp.load(kAcquire), copy.parent, frame.latest.pose.load()};
        if (copy.is_append) copy.first_new = copy.count;  // only the version has changed
        return 0;
      }
      const Ring ring = frame.ring.load(kAcquire);
      if (!ring) return 0;  // a torn read
      const std::uint32_t first = frame.first.load(kAcquire);
      const bool has_parents = frame.parent_changes.load(kAcquire) != 0;
      std::uint32_t begin = copy.count;  // of those that were not sent
      if (copy.is_append)
        while (begin > 0 && copy.count - begin < ring.capacity() &&
               ring.stamp(first + begin - 1) > sent->newest)
          --begin;
      else
        begin = 0;
      if (newest_only_) begin = std::max(begin, copy.count - 1);
      const std::uint32_t from = !with_all ? begin : newest_only_ ? copy.count - 1 : 0;
      copy.first_new = begin - from;
      copy.fits = copy.count - from <= samples.size();
      if (!copy.fits) return 0;
      for (std::uint32_t i = from; i < copy.count; ++i)
        samples[i - from] = {ring.stamp(first + i),
                             has_parents ? ring.parent(first + i) : copy.parent,
                             ring.sample(first + i).pose.load()};
      copy.count -= from;
      return 0;
    });
    room = std::min<std::size_t>(copy.count, tree_.options.max_samples_per_frame) + 16;
  } while (!copy.fits);
  samples.resize(copy.count);
}

// Whether all that was read was the tree's state at one instant.
bool InterestReader::is_valid() const {
  yield_point();
  for (const Copy& copy : copies_)
    if (tree_.version(copy.id) != copy.version || (copy.is_new && copy.ref.id != copy.id))
      return false;
  for (const ReadVersion& read : reads_)
    if (tree_.version(read.frame) != read.version) return false;
  if (tree_.ids_freed.load(kAcquire) != ids_freed_) return false;
  if (pairs_.empty()) return tree_.names.size() == size_;
  for (std::size_t i = 0; i < new_refs_.size(); ++i)
    if (!(tree_.names.find_ref(i % 2 ? pairs_[i / 2].second : pairs_[i / 2].first) == new_refs_[i]))
      return false;
  return true;
}

// Makes the result of a read, which may turn out to be invalid.
InterestReader::Result InterestReader::make_result(bool with_all) {
  Result result{seq_, ever_reparented_, {}, {}};
  Rows changes(tree_, result.changes), all(tree_, result.all);
  const std::unordered_set<FrameId> present(frames_.begin(), frames_.end());
  for (const auto& [id, sent] : sent_)
    if (!present.contains(id) || !tree_.names.is_current(sent.ref)) {
      removed_.push_back(id);
      // The frame may come back with the version that it has now.
      changes.add(ChangeKind::removed, changes.name(sent.name), sent.version + kVersionBound);
    }
  // Beside changes of theirs, because the first reparenting gives all frames a new version.
  if (ever_reparented_ && !sent_reparented_ && !copies_.empty())
    changes.add(ChangeKind::new_version, changes.name(copies_.front().id), copies_.front().version);
  for (const Copy& copy : copies_) {
    const auto at = sent_.find(copy.id);
    if (copy.is_new || at->second.version != copy.version) add_frame(copy, false, changes);
    if (with_all) add_frame(copy, true, all);
  }
  return result;
}

// Records what the last make_result() has returned.
void InterestReader::keep_sent() {
  for (const FrameId id : removed_) sent_.erase(id);
  for (Copy& copy : copies_) {
    Sent& sent = sent_[copy.id];
    if (copy.is_new) {
      sent.name = std::move(copy.name);
      sent.ref = copy.ref;
    }
    sent.version = copy.version;
    sent.edits = copy.edits;
    if (!copy.samples.empty()) sent.newest = copy.samples.back().stamp;
  }
  sent_reparented_ |= ever_reparented_ && !copies_.empty();
  sent_seq_ = seq_;
  refs_ = new_refs_;
  watched_.clear();
  for (const auto& [id, link] : links_)
    if (!wanted_.contains(id)) watched_.emplace_back(id, link);
  sent_frames_.store(sent_.size(), std::memory_order_relaxed);
}

void InterestReader::add_frame(const Copy& copy, bool all, Rows& rows) const {
  const std::uint32_t frame = rows.name(copy.id);
  if (!all && !copy.is_new && !copy.is_append) {
    // Newest samples alone are kept if they may still belong to the history.
    const Stamp before = sent_.at(copy.id).newest;
    const bool goes_on = newest_only_ && !copy.is_static && !copy.samples.empty() &&
                         copy.oldest <= before && copy.samples.back().stamp >= before;
    if (!goes_on) rows.add(ChangeKind::cleared, frame, copy.version);
  }
  const std::size_t begin = all ? 0 : copy.first_new;
  if (begin == copy.samples.size()) rows.add(ChangeKind::created, frame, copy.version);
  for (std::size_t i = begin; i < copy.samples.size(); ++i)
    rows.add_sample(copy, frame, copy.samples[i]);
}

}  // namespace ztf
