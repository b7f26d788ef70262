#include "messages/decoded_size.hpp"

#include "messages/cursor.hpp"

namespace ztf {

namespace {

constexpr int kMaxDepth = 32;  // messages of the protocol have 6 levels

// About what CPython needs, in bytes.
constexpr std::uint64_t kNumber = 32, kText = 56, kBinary = 40, kList = 72, kMap = 240;
constexpr std::uint64_t kListEntry = 8, kMapEntry = 32;

}  // namespace

std::int64_t decoded_size(std::string_view message) {
  using enum MessageHead::Kind;
  MessageCursor cursor(message);
  std::uint64_t size = 0;
  std::uint64_t waiting = 0;            // values that open containers still claim
  std::uint64_t open[kMaxDepth] = {1};  // the same of each container
  for (int depth = 0;;) {
    for (; open[depth] == 0; --depth)
      if (depth == 0) return static_cast<std::int64_t>(size);
    --open[depth];
    waiting -= waiting != 0;
    MessageHead head;
    std::string_view skipped;
    if (!cursor.head(head)) return kMalformed;
    if (head.kind != list && head.kind != map) {
      if (!cursor.take(head.size, skipped)) return kMalformed;
      // CPython shares constants and small integers.
      size += head.kind == constant ? 0
              : head.kind == number ? kNumber
                                    : head.size + (head.kind == text ? kText : kBinary);
      continue;
    }
    // Every value takes a byte at least, so a head that claims more than is left is forged.
    const std::uint64_t values = head.kind == map ? 2 * head.size : head.size;
    if (values + waiting > cursor.left()) return kMalformed;
    if (depth + 1 == kMaxDepth) return kTooDeep;
    size += head.kind == map ? kMap + kMapEntry * head.size : kList + kListEntry * head.size;
    waiting += values;
    open[++depth] = values;
  }
}

}  // namespace ztf
