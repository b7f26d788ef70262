// What the binding files share: Python values in and out, and errors.
//
// Thread safety: everything here needs the interpreter lock.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <string_view>
#include <utility>

#include "tree.hpp"

namespace ztf {

namespace nb = nanobind;

// The Python-visible values. Poses are not normalised or checked before they
// are set in a tree, which can name the frames concerned.
struct StampedTransform {
  nb::object parent_frame, child_frame;  // str
  Stamp stamp;
  Pose pose;
};
struct LatestTransform : StampedTransform {
  Stamp newest;
};

// errors.BY_CODE[code](message, **facts)
nb::object make_error(Code code, const std::string& message, const nb::dict& facts);
nb::object make_error(const Rejected& refused);
nb::object make_error(const Tree& tree, const Failure& failure, nb::handle target,
                      nb::handle source, const std::string& note = "");
// What is added to the message of a lookup that has waited in vain.
std::string waited(double timeout_s);
[[noreturn]] void raise(const nb::object& error);
[[noreturn]] void raise_invalid(const std::string& message, const char* field);

bool is_main_thread();  // Python's
// Without the interpreter lock, for as long as it takes: also where the process
// ends meanwhile.
class Unlocked {
 public:
  Unlocked();
  ~Unlocked();
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

 private:
  PyThreadState* const state_;
};

// A str's UTF-8, which lives as long as the str.
std::string_view text_of(nb::handle name, const char* field);
// A frame's id, 0 where there is none; names that no frame can have are errors.
FrameId frame_of(const Tree& tree, nb::handle name, const char* field);
Query query_of(const Tree& tree, Op op, nb::handle target, nb::handle source);
Stamp stamp_of(nb::handle stamp, const char* field);  // kNoStamp for None
// Exactly n numbers from a sequence.
void numbers_of(nb::handle values, double* out, Py_ssize_t n, const char* field);
Pose pose_of(nb::handle translation, nb::handle rotation);
// A numpy array of float64, C-contiguous, from any array of real numbers or nested sequences; a
// copy only where it has to be.
nb::object doubles_of(nb::handle values, const char* field);

template <class T>
using Column = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using PoseColumn = nb::ndarray<const double, nb::shape<-1, 7>, nb::c_contig, nb::device::cpu>;

// A new numpy array; `fill` gets its storage.
template <class T, std::size_t N, class Fill>
nb::object make_array(const std::size_t (&shape)[N], Fill&& fill) {
  std::size_t size = 1;
  for (const std::size_t n : shape) size *= n;
  T* data = new T[size ? size : 1];
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  fill(data);
  return nb::cast(nb::ndarray<nb::numpy, T>(data, N, shape, owner));
}

// tree.commit(), with its refusal as a Python error.
void commit(Tree& tree, const CommitRequest& request, std::span<std::uint8_t> stored,
            bool release_interpreter);

void bind_values(nb::module_& m);
void bind_apply(nb::class_<Pose>& transform);
void bind_tree(nb::module_& m);
void bind_read(nb::module_& m, nb::class_<Tree>& tree);
void bind_commit(nb::module_& m, nb::class_<Tree>& tree);
void bind_waiting(nb::module_& m);
void bind_introspection(nb::class_<Tree>& tree);
void bind_velocity(nb::class_<Tree>& tree);

}  // namespace ztf
