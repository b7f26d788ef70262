// How a reader gets from ids to frames and their rings.
//
// This one trusts what it reads, as it reads the memory of its own process. MappedFrames does not
// (shared/mapped_memory.hpp).
//
// Thread safety: constant.
#pragma once

#include "records/frame.hpp"

namespace ztf {

class FrameAccess {
 public:
  ZTF_ALWAYS_INLINE explicit FrameAccess(const Frame* frames) noexcept : frames_(frames) {}

  [[nodiscard]] ZTF_ALWAYS_INLINE const Frame* frame(FrameId id) const noexcept {
    return frames_ + id;
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE Ring ring(const Frame& frame) const noexcept {
    return frame.ring.load(std::memory_order_acquire);
  }
  [[nodiscard]] FrameId id_of(const Frame* frame) const noexcept {
    return static_cast<FrameId>(frame - frames_);
  }

 private:
  const Frame* const frames_;
};

}  // namespace ztf
