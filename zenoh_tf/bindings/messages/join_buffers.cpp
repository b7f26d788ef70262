// join_buffers: what bytes.join does, without the GIL while it copies. decoded_size: what a message
// will cost before it is decoded.
#include <cstring>

#include "bindings/bindings.hpp"
#include "messages/decoded_size.hpp"

namespace ztf {

namespace {

constexpr std::size_t kReleaseFrom = 64 * 1024;  // bytes from which releasing the GIL pays

// The buffers of a sequence. Requires the GIL.
class Buffers {
 public:
  explicit Buffers(const nb::tuple& parts) : views_(parts.size()) {
    for (const nb::handle part : parts) {
      if (PyObject_GetBuffer(part.ptr(), &views_[held_], PyBUF_SIMPLE) != 0)
        throw nb::python_error();
      ++held_;
      size_ += static_cast<std::size_t>(views_[held_ - 1].len);
    }
  }
  ~Buffers() {
    for (std::size_t i = 0; i < held_; ++i) PyBuffer_Release(&views_[i]);
  }
  Buffers(const Buffers&) = delete;
  Buffers& operator=(const Buffers&) = delete;

  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  // Needs no GIL.
  void copy_to(char* out) const noexcept {
    for (const Py_buffer& view : views_) {
      std::memcpy(out, view.buf, static_cast<std::size_t>(view.len));
      out += view.len;
    }
  }

 private:
  std::vector<Py_buffer> views_;
  std::size_t held_ = 0;
  std::size_t size_ = 0;
};

nb::bytes join_buffers(nb::handle parts) {
  const nb::tuple kept = tuple_of(parts);
  const Buffers buffers(kept);
  // Nobody else sees the bytes before they are returned, so they may be written without the GIL.
  const nb::object joined =
      nb::steal(PyBytes_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(buffers.size())));
  if (!joined.is_valid()) throw nb::python_error();
  char* const out = PyBytes_AsString(joined.ptr());
  {
    const GilReleased released;
    buffers.copy_to(out);
  }
  return nb::borrow<nb::bytes>(joined);
}

}  // namespace

void bind_join_buffers(nb::module_& m) {
  m.def("join_buffers", &join_buffers, nb::arg("parts"));
  m.def(
      "decoded_size",
      [](const nb::bytes& message) {
        const std::string_view data(message.c_str(), message.size());
        return without_gil_if(data.size() >= kReleaseFrom, [&] { return decoded_size(data); });
      },
      nb::arg("message"));
}

}  // namespace ztf
