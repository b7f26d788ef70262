// The guards and the seqlock one by one, without other threads: what each accepts, refuses and
// leaves behind.
#include <memory>

#include "fixture.hpp"
#include "modes/two_phase.hpp"

using namespace ztf;

namespace {

struct Frames {
  static constexpr std::size_t kFrames = 100;
  std::unique_ptr<Frame[]> frames{new Frame[kFrames]()};
  ReadSet reads;

  Frame& operator[](std::size_t i) { return frames[i]; }
  void change(std::size_t i) {
    frames[i].version.unlock_changed(next_version(frames[i].version.lock_writer()));
  }
  template <class Guard>
  bool read(Guard& guard, std::size_t i) {
    Version version;
    if (!guard.read_version(frames[i], version)) return false;
    const PathStep step{&frames[i], version, {}};
    return guard.validate({&step, 1});
  }
};

bool can_be_locked(Frame& frame) {
  Version before;
  if (!frame.version.try_lock_writer(before)) return false;
  frame.version.unlock_unchanged(before);
  return true;
}

}  // namespace

TEST(a_walk_is_valid_while_the_versions_are_unchanged) {
  Frames f;
  WalkGuard guard;
  Version version;
  CHECK(guard.read_version(f[1], version));
  const PathStep step{&f[1], version, {}};
  CHECK(guard.validate({&step, 1}));
  const Version before = f[1].version.lock_writer();
  f[1].version.begin_write(before);
  CHECK(!guard.validate({&step, 1}));
  f[1].version.unlock_unchanged(before);
  CHECK(guard.validate({&step, 1}));
  f.change(1);
  CHECK(!guard.validate({&step, 1}));
}

TEST(a_writer_disturbs_no_reader_before_it_begins_to_write) {
  Frames f;
  f.change(1);
  WalkGuard guard;
  Version version, before, other;
  CHECK(f[1].version.try_lock_writer(before));
  CHECK(guard.read_version(f[1], version));  // does not wait
  CHECK_EQ(version, before);
  const PathStep step{&f[1], version, {}};
  CHECK(guard.validate({&step, 1}));
  CHECK(!f[1].version.try_lock_writer(other));  // other writers do
  CHECK(!f[1].version.try_lock_and_begin_write(other));
  f[1].version.begin_write(before);
  CHECK(f[1].version.current() & SeqLock::kWriting);
  CHECK(!guard.validate({&step, 1}));
  f[1].version.unlock_unchanged(before);
  CHECK(guard.validate({&step, 1}));
}

// Every optimistic attempt is disturbed, so the read must end by locking.
TEST(a_consistent_read_locks_after_a_bounded_number_of_attempts) {
  Frames f;
  SeqLock& lock = f[1].version;
  int attempts = 0, changes = 0;
  const auto read = [&](Version version) noexcept {
    Version before;
    if (++attempts < 1000 && lock.try_lock_writer(before)) {
      lock.unlock_changed(next_version(before));
      ++changes;
    }
    return version;
  };
  const Version version = lock.read_consistent(read);
  CHECK_EQ(attempts, SeqLock::kOptimisticReads + 1);
  CHECK_EQ(changes, SeqLock::kOptimisticReads);
  CHECK_EQ(version, lock.current());
  CHECK(can_be_locked(f[1]));
}

TEST(the_optimistic_guard_validates_all_reads_at_the_end) {
  Frames f;
  {
    OptimisticGuard guard(f.frames.get(), f.reads);
    CHECK(f.read(guard, 1) && f.read(guard, 2));
    f.change(3);
    CHECK(guard.validate_all());
    f.change(1);
    CHECK(!guard.validate_all());
  }
  OptimisticGuard guard(f.frames.get(), f.reads);
  CHECK_EQ(f.reads.size(), 0u);  // the last attempt's reads are gone
  CHECK(f.read(guard, 1));
  CHECK(guard.validate_all());
  CHECK_EQ(f.reads[0].version, kVersionStep);
}

TEST(the_locking_guard_takes_each_wanted_lock_once_and_releases_all) {
  Frames f;
  f.change(7);
  SmallVector<FrameId, 64> wanted;
  for (const FrameId id : {9u, 7u, 9u}) wanted.push_back(id);
  {
    LockingGuard guard(f.frames.get(), f.reads, wanted);
    for (const std::size_t i : {7, 9}) CHECK(!can_be_locked(f[i]));  // writers wait
    CHECK_EQ(f[7].version.current(), kVersionStep);                  // readers do not
    CHECK(f.read(guard, 7));
    CHECK(guard.validate_all());
    CHECK(f.read(guard, 8));  // not locked: reads it, but fails at the end
    CHECK(!guard.validate_all());
  }
  for (const std::size_t i : {7, 8, 9}) CHECK(can_be_locked(f[i]));
  {
    LockingGuard guard(f.frames.get(), f.reads, wanted);
    CHECK(f.read(guard, 7) && f.read(guard, 8) && f.read(guard, 9));
    CHECK(guard.validate_all());
    CHECK_EQ(f.reads.size(), 3u);
    CHECK_EQ(f.reads[0].version, kVersionStep);  // the version before it was locked
  }
  CHECK_EQ(f[7].version.current(), kVersionStep);
}

TEST(a_shared_guard_heeds_a_starving_writer_if_told_to) {
  Frames f;
  {
    SharedGuard guard(f.frames.get(), f.reads, true);
    CHECK(f.read(guard, 1) && f.read(guard, 1));  // a second read locks again
    CHECK(!f[1].shared.try_lock());
    f[1].shared.want();
    CHECK(!f.read(guard, 1));
    SharedGuard ruthless(f.frames.get(), f.reads, false);
    CHECK(f.read(ruthless, 1));
    CHECK(!f[1].shared.try_lock());
  }
  CHECK(f[1].shared.try_lock());
  CHECK(f[1].shared.try_lock_shared(false) == SharedLock::TryResult::writer_holds);
  f[1].shared.unlock();
  SharedGuard guard(f.frames.get(), f.reads, true);
  CHECK(f.read(guard, 1));  // the lock was taken, so it is no longer wanted
}
