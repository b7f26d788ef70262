// What one message to the server may cost, and what of that is left.
//
// Thread safety: everything here requires the GIL.
#pragma once

#include "bindings/bindings.hpp"

namespace ztf {

class Budget {
 public:
  // One limit: `take` raises LimitExceeded, with the limit's name as `field`, and takes nothing.
  class Share {
   public:
    Share(const char* field, const char* meaning, std::uint64_t limit)
        : field_(field), meaning_(meaning), limit_(limit) {}

    [[nodiscard]] std::uint64_t limit() const noexcept { return limit_; }
    [[nodiscard]] std::uint64_t left() const noexcept { return limit_ - used_; }
    void take(std::uint64_t n) {
      if (n > left()) exceeded(used_ + n);
      used_ += n;
    }
    // Takes what is left, and raises: for work that stopped when it needed more.
    [[noreturn]] void exhausted() {
      used_ = limit_;
      exceeded(limit_ + 1);
    }

   private:
    [[noreturn]] void exceeded(std::uint64_t value) const;

    const char* const field_;
    const char* const meaning_;
    const std::uint64_t limit_;
    std::uint64_t used_ = 0;
  };

  Budget(std::uint64_t links, std::uint64_t read_set, std::uint64_t listed,
         std::uint64_t reply_bytes, std::uint64_t error_bytes);

  Share links, read_set, listed, reply_bytes;
  std::uint64_t error_bytes;  // left; beyond it rows that fail have only their status
};

}  // namespace ztf
