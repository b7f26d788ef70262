// Motion compensation of a sweep: each point goes to where it would have been measured at one time.
//
// Thread safety: every function, on arrays that no other thread changes.
#pragma once

#include <algorithm>
#include <array>
#include <memory>

#include "base/stamp.hpp"
#include "geometry/point_map.hpp"

namespace ztf {

// The stamps of a PointArray's points, (rows, columns) of them.
struct StampArray {
  const std::byte* data;
  std::ptrdiff_t row_stride, column_stride;

  [[nodiscard]] ZTF_ALWAYS_INLINE Stamp operator()(std::size_t row,
                                                   std::size_t column) const noexcept {
    Stamp stamp;
    std::memcpy(&stamp,
                data + static_cast<std::ptrdiff_t>(row) * row_stride +
                    static_cast<std::ptrdiff_t>(column) * column_stride,
                sizeof stamp);
    return stamp;
  }
};

// The maps of some times, each computed once. Points of a sweep share their times: those of one
// column, or the times come again with every ring. So it pays to remember them.
class MapTable {
 public:
  static constexpr std::size_t kSize = 4096;  // maps

  // Throws bad_alloc.
  MapTable() : maps_(std::make_unique_for_overwrite<PointMap[]>(kSize)) { clear(); }

  void clear() noexcept {
    count_ = computed_ = 0;
    slots_.fill(kEmpty);
  }
  // True if so many more times may not fit.
  [[nodiscard]] bool is_full_for(std::size_t times) const noexcept {
    return count_ + times > kSize - 4;
  }
  // Returns the number of a time's map, which is set after the next compute(). Requires room.
  ZTF_ALWAYS_INLINE std::uint32_t number_of(Stamp time) noexcept {
    for (std::size_t slot = hash(time);; slot = (slot + 1) % slots_.size()) {
      const std::uint16_t found = slots_[slot];
      if (found == kEmpty) {
        slots_[slot] = static_cast<std::uint16_t>(count_);
        times_[count_] = time;
        return count_++;
      }
      if (times_[found] == time) return found;
    }
  }
  // Computes what is missing by motion.compute(times, maps).
  template <class AnyMotion>
  void compute(AnyMotion& motion) {
    if (computed_ == count_) return;
    motion.compute(std::span(times_).subspan(computed_, count_ - computed_), &maps_[computed_]);
    computed_ = count_;
  }
  [[nodiscard]] const PointMap* maps() const noexcept { return maps_.get(); }

 private:
  static constexpr std::uint16_t kEmpty = 0xffff;

  static std::size_t hash(Stamp time) noexcept {
    return static_cast<std::size_t>((static_cast<std::uint64_t>(time) * 0x9e3779b97f4a7c15u) >>
                                    (64 - 13));
  }

  std::uint32_t count_, computed_;
  std::array<std::uint16_t, 2 * kSize> slots_;
  std::array<Stamp, kSize> times_;
  std::unique_ptr<PointMap[]> maps_;
};

// The poses of a frame at some times, which were looked up one by one.
class SampledMotion {
 public:
  // Takes poses X_fixed_source at ascending times. The motion is that in the source frame as it is
  // in `at`, X_fixed_source at another time.
  SampledMotion(std::span<const Stamp> times, std::span<const Pose> poses, const Pose& at) noexcept
      : times_(times), poses_(poses), left_(inverse(at)) {}

  // As Motion::compute(). Requires times that are among those given.
  void compute(std::span<const Stamp> times, PointMap* maps) const noexcept {
    for (std::size_t i = 0; i < times.size(); ++i) {
      const auto found = std::lower_bound(times_.begin(), times_.end(), times[i]);
      maps[i] = PointMap::of(left_ * poses_[static_cast<std::size_t>(found - times_.begin())]);
    }
  }

 private:
  const std::span<const Stamp> times_;
  const std::span<const Pose> poses_;
  const Pose left_;
};

// Writes all points as they would have been measured at the time that the motion is fixed at.
// Requires arrays of the same shape, which are the same or do not overlap. Throws bad_alloc.
template <class AnyMotion>
void deskew(AnyMotion& motion, const StampArray& stamps, const PointArray& in,
            const PointArray& out) {
  constexpr std::size_t kPortion = 1024;  // points whose maps are computed before they are used
  const auto table = std::make_unique<MapTable>();
  std::array<std::uint32_t, kPortion> numbers;
  for (std::size_t row = 0; row < in.rows; ++row)
    for (std::size_t begin = 0; begin < in.columns; begin += kPortion) {
      const std::size_t points = std::min(kPortion, in.columns - begin);
      if (table->is_full_for(points)) table->clear();
      Stamp last = stamps(row, begin);
      std::uint32_t number = table->number_of(last);
      for (std::size_t i = 0; i < points; ++i) {
        const Stamp time = stamps(row, begin + i);
        if (time != last) number = table->number_of(time);
        last = time;
        numbers[i] = number;
      }
      table->compute(motion);
      map_numbered(table->maps(), {numbers.data(), points}, in.part(row, begin, points),
                   out.part(row, begin, points));
    }
}

}  // namespace ztf
