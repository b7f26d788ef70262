// The guards one by one, without luck: what each accepts, refuses and leaves behind.
#include <memory>

#include "fixture.hpp"

using namespace ztf;

namespace {

struct Frames {
  static constexpr std::size_t kFrames = 100;
  std::unique_ptr<Frame[]> frames{new Frame[kFrames]()};
  ReadSet reads;

  Frame& operator[](std::size_t i) { return frames[i]; }
  void change(std::size_t i) { frames[i].version.unlock_changed(frames[i].version.lock_writer()); }
  template <class Guard>
  bool read(Guard& guard, std::size_t i) {
    Version version;
    if (!guard.read_version(frames[i], version)) return false;
    const PathStep step{&frames[i], version, {}};
    return guard.validate(&step, 1);
  }
};

bool can_be_owned(Frame& frame) {
  Version before;
  if (!frame.version.try_lock_writer(before)) return false;
  frame.version.unlock_unchanged(before);
  return true;
}

}  // namespace

TEST(a_walk_rests_on_unmoved_versions) {
  Frames f;
  WalkGuard guard;
  Version version;
  CHECK(guard.read_version(f[1], version));
  const PathStep step{&f[1], version, {}};
  CHECK(guard.validate(&step, 1));
  const Version before = f[1].version.lock_writer();
  f[1].version.begin_write(before);
  CHECK(!guard.validate(&step, 1));
  f[1].version.unlock_unchanged(before);
  CHECK(guard.validate(&step, 1));
  f.change(1);
  CHECK(!guard.validate(&step, 1));
}

TEST(who_only_has_a_frame_disturbs_no_reader_until_it_changes_it) {
  Frames f;
  f.change(1);
  WalkGuard guard;
  Version version, before, other;
  CHECK(f[1].version.try_lock_writer(before));
  CHECK(guard.read_version(f[1], version));  // does not wait
  CHECK_EQ(version, before);
  const PathStep step{&f[1], version, {}};
  CHECK(guard.validate(&step, 1));
  CHECK(!f[1].version.try_lock_writer(other));  // but writers do
  CHECK(!f[1].version.try_lock(other));
  f[1].version.begin_write(before);
  CHECK(f[1].version.load() & SeqLock::kWriting);
  CHECK(!guard.validate(&step, 1));
  f[1].version.unlock_unchanged(before);
  CHECK(guard.validate(&step, 1));
}

TEST(optimism_is_checked_at_the_end) {
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
  CHECK_EQ(f.reads.size(), 0u);  // nothing of the last attempt is left
  CHECK(f.read(guard, 1));
  CHECK(guard.validate_all());
  CHECK_EQ(f.reads[0].version, SeqLock::kIncrement);
}

TEST(locks_are_taken_once_more_are_wanted_and_all_released) {
  Frames f;
  f.change(7);
  SmallVector<FrameId, 64> wanted;
  for (const FrameId id : {9u, 7u, 9u}) wanted.push_back(id);
  {
    LockingGuard guard(f.frames.get(), f.reads, wanted);
    for (const std::size_t i : {7, 9}) CHECK(!can_be_owned(f[i]));  // by a writer
    CHECK_EQ(f[7].version.load(), SeqLock::kIncrement);             // other readers go on
    CHECK(f.read(guard, 7));
    CHECK(guard.validate_all());
    CHECK(f.read(guard, 8));  // reads on, to learn what else it needs
    CHECK(!guard.validate_all());
  }
  for (const std::size_t i : {7, 8, 9}) CHECK(can_be_owned(f[i]));
  {
    LockingGuard guard(f.frames.get(), f.reads, wanted);
    CHECK(f.read(guard, 7) && f.read(guard, 8) && f.read(guard, 9));
    CHECK(guard.validate_all());
    CHECK_EQ(f.reads.size(), 3u);
    CHECK_EQ(f.reads[0].version, SeqLock::kIncrement);  // as it was, not as it is locked
  }
  CHECK_EQ(f[7].version.load(), SeqLock::kIncrement);
}

TEST(shared_locks_heed_a_starving_writer_for_a_while) {
  Frames f;
  {
    SharedGuard guard(f.frames.get(), f.reads, true);
    CHECK(f.read(guard, 1) && f.read(guard, 1));  // twice is once more
    CHECK(!f[1].shared.try_lock());
    f[1].shared.want();
    CHECK(!f.read(guard, 1));
    SharedGuard ruthless(f.frames.get(), f.reads, false);
    CHECK(f.read(ruthless, 1));
    CHECK(!f[1].shared.try_lock());
  }
  CHECK(f[1].shared.try_lock());
  CHECK(f[1].shared.try_lock_shared(false) == SharedLock::Shared::writer);
  f[1].shared.unlock();
  SharedGuard guard(f.frames.get(), f.reads, true);
  CHECK(f.read(guard, 1));  // who got the lock wants it no more
}
