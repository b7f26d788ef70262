// decoded_size: what a MessagePack message will cost before it is decoded.
//
// A byte of a message may become a Python object of 100 bytes, and the header of a list claims
// memory for its entries before they are there. So the decoder runs only on messages that passed.
#include <algorithm>

#include "bindings/bindings.hpp"

namespace ztf {

namespace {

constexpr int kMaxDepth = 32;                    // messages of the protocol have 6 levels
constexpr std::size_t kReleaseFrom = 64 * 1024;  // bytes from which releasing the GIL pays
constexpr std::int64_t kMalformed = -1;
constexpr std::int64_t kTooDeep = -2;

// About what CPython needs, in bytes.
constexpr std::uint64_t kNumber = 32, kText = 56, kBinary = 40, kList = 72, kMap = 240;
constexpr std::uint64_t kListEntry = 8, kMapEntry = 32;

// Reads headers one after the other; texts and binaries are skipped.
class Scan {
 public:
  explicit Scan(std::string_view data) : data_(data) {}

  // The bytes that the decoded message takes; kMalformed or kTooDeep.
  std::int64_t run() {
    open_[0] = 1;
    for (;;) {
      while (open_[depth_] == 0) {
        if (depth_ == 0) return static_cast<std::int64_t>(size_);
        --depth_;
      }
      --open_[depth_];
      if (const std::int64_t fault = value()) return fault;
    }
  }

 private:
  [[nodiscard]] std::size_t left() const noexcept { return data_.size() - at_; }

  // Reads a big-endian number of `bytes` bytes. False: the message ends before.
  bool number(std::size_t bytes, std::uint64_t& out) {
    if (left() < bytes) return false;
    out = 0;
    for (std::size_t i = 0; i < bytes; ++i)
      out = out << 8 | static_cast<unsigned char>(data_[at_++]);
    return true;
  }
  std::int64_t skip(std::uint64_t bytes, std::uint64_t cost) {
    if (left() < bytes) return kMalformed;
    at_ += bytes;
    size_ += cost;
    return 0;
  }
  // `bytes`: the size of the length field.
  std::int64_t sized(std::size_t bytes, std::uint64_t cost, std::uint64_t type_bytes = 0) {
    std::uint64_t n = 0;
    return number(bytes, n) ? skip(n + type_bytes, cost + n) : kMalformed;
  }
  // Every value takes a byte at least, so a header that claims more than is left is forged.
  std::int64_t container(std::uint64_t values, std::uint64_t cost) {
    if (values > left() || values + waiting_ > left()) return kMalformed;
    if (depth_ + 1 == kMaxDepth) return kTooDeep;
    size_ += cost;
    waiting_ += values;
    open_[++depth_] = values;
    return 0;
  }
  std::int64_t list(std::uint64_t n) { return container(n, kList + kListEntry * n); }
  std::int64_t map(std::uint64_t n) { return container(2 * n, kMap + kMapEntry * n); }
  std::int64_t sized_list(std::size_t bytes) {
    std::uint64_t n = 0;
    return number(bytes, n) ? list(n) : kMalformed;
  }
  std::int64_t sized_map(std::size_t bytes) {
    std::uint64_t n = 0;
    return number(bytes, n) ? map(n) : kMalformed;
  }

  std::int64_t value() {
    if (left() == 0) return kMalformed;
    waiting_ -= waiting_ != 0;
    const auto head = static_cast<unsigned char>(data_[at_++]);
    if (head < 0x80 || head >= 0xe0) return skip(0, 0);  // CPython shares small integers
    if (head < 0x90) return map(head & 0x0f);
    if (head < 0xa0) return list(head & 0x0f);
    if (head < 0xc0) return skip(head & 0x1f, kText + (head & 0x1f));
    switch (head) {
      case 0xc0:  // nil, false, true
      case 0xc2:
      case 0xc3:
        return 0;
      case 0xc4:
      case 0xc5:
      case 0xc6:
        return sized(std::size_t{1} << (head - 0xc4), kBinary);
      case 0xc7:
      case 0xc8:
      case 0xc9:
        return sized(std::size_t{1} << (head - 0xc7), kBinary, 1);
      case 0xca:
        return skip(4, kNumber);
      case 0xcb:
        return skip(8, kNumber);
      case 0xcc:
      case 0xcd:
      case 0xce:
      case 0xcf:
        return skip(std::size_t{1} << (head - 0xcc), kNumber);
      case 0xd0:
      case 0xd1:
      case 0xd2:
      case 0xd3:
        return skip(std::size_t{1} << (head - 0xd0), kNumber);
      case 0xd4:
      case 0xd5:
      case 0xd6:
      case 0xd7:
      case 0xd8:
        return skip(1 + (std::size_t{1} << (head - 0xd4)), kBinary);
      case 0xd9:
      case 0xda:
      case 0xdb:
        return sized(std::size_t{1} << (head - 0xd9), kText);
      case 0xdc:
      case 0xdd:
        return sized_list(head == 0xdc ? 2 : 4);
      case 0xde:
      case 0xdf:
        return sized_map(head == 0xde ? 2 : 4);
      default:
        return kMalformed;
    }
  }

  const std::string_view data_;
  std::size_t at_ = 0;
  std::uint64_t size_ = 0;
  std::uint64_t waiting_ = 0;  // values that open containers still claim
  std::uint64_t open_[kMaxDepth] = {};
  int depth_ = 0;
};

std::int64_t decoded_size(const nb::bytes& message) {
  const std::string_view data(message.c_str(), message.size());
  return without_gil_if(data.size() >= kReleaseFrom, [&] { return Scan(data).run(); });
}

}  // namespace

void bind_message_size(nb::module_& m) { m.def("decoded_size", &decoded_size, nb::arg("message")); }

}  // namespace ztf
