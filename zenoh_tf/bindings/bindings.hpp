// What the binding files share: Python values in and out, errors, the GIL.
//
// Thread safety: everything here requires the GIL.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <memory>
#include <new>
#include <optional>
#include <string_view>
#include <utility>

#include "bindings/gil.hpp"
#include "by_name/errors.hpp"
#include "docs.hpp"
#include "shared/shared_tree.hpp"
#include "tree.hpp"

// A method's signature and docstring, from the stubs.
#define ZTF_DOC(name) nb::sig(docs::name.signature), docs::name.text
#define ZTF_PROPERTY_DOC(name) nb::for_getter(nb::sig(docs::name.signature)), docs::name.text

namespace ztf {

namespace nb = nanobind;

// --- values

// Poses are not validated here but where they are set in a tree, whose error names the frames.
struct StampedTransform {
  nb::object parent_frame, child_frame;  // str
  Stamp stamp;
  Pose pose;
  Stamp gap = 0;  // ns
};
struct LatestTransform : StampedTransform {
  Stamp newest;
};

// --- errors

// errors.BY_CODE[code](message, **facts)
nb::object make_error(const Rejected& rejected);
[[noreturn]] void raise(const nb::object& error);
[[noreturn]] void raise(const Rejected& rejected);
[[noreturn]] void raise_invalid(const std::string& message, const char* field);
// The error of a call for which the host has no memory left.
nb::object make_memory_error();
// Runs body(), and raises what it throws as Rejected, or as bad_alloc.
template <class Body>
auto rejected_as_error(Body&& body) {
  try {
    return body();
  } catch (const Rejected& rejected) {
    raise(rejected);
  } catch (const std::bad_alloc&) {
    raise(make_memory_error());
  }
}

// --- the GIL

bool is_main_thread();  // Python's
// Releases the GIL in its scope. Unlike nanobind's guard it is safe in daemon threads while the
// interpreter shuts down: such a thread then never returns.
class GilReleased {
 public:
  GilReleased();
  ~GilReleased();
  GilReleased(const GilReleased&) = delete;
  GilReleased& operator=(const GilReleased&) = delete;

 private:
  PyThreadState* const state_;
};

// Runs body(), without the GIL if that is long enough to pay.
template <class Body>
auto without_gil_if(bool is_long, Body&& body) {
  std::optional<GilReleased> released;
  if (is_long) released.emplace();
  return body();
}

// Keeps the GIL in its scope unless the core waits for long, and has it again afterwards. It costs
// a few nanoseconds. The scope must hold one call of the core, or several that use no Python.
class GilReleasedOnWait final : private LongWait {
 public:
  GilReleasedOnWait() noexcept : registration_(LongWait::registered()) { registration_ = this; }
  ~GilReleasedOnWait() {
    registration_ = nullptr;
    if (state_) [[unlikely]]
      take_back();
  }
  GilReleasedOnWait(const GilReleasedOnWait&) = delete;
  GilReleasedOnWait& operator=(const GilReleasedOnWait&) = delete;

 private:
  void begin() noexcept override { state_ = PyEval_SaveThread(); }
  void take_back();

  LongWait*& registration_;
  PyThreadState* state_ = nullptr;
};

// --- arguments; `field` names the argument in InvalidArgumentException

nb::str str_of(std::string_view text);
inline std::string_view view_of(const nb::bytes& data) { return {data.c_str(), data.size()}; }
// None of nullopt.
nb::object bytes_of(const std::optional<std::string>& data);
// An argument for text_of(), which says what it must be. So it comes to it if it is None, too.
inline auto name_arg(const char* name) { return nb::arg(name).none(); }
// A str's UTF-8; valid as long as the str.
std::string_view text_of(nb::handle name, const char* field);
// The same, of a name that a frame may have; raises for others.
std::string_view frame_name_of(nb::handle name, const char* field);
// A query whose names are valid as long as the strs.
inline NamedQuery query_of(Op op, nb::handle target, nb::handle source) {
  NamedQuery query;
  query.op = op;
  query.target_name = frame_name_of(target, "target_frame");
  query.source_name = frame_name_of(source, "source_frame");
  return query;
}
// Fills `texts` with the UTF-8 of the names, which are valid as long as the tuple. Raises
// LimitExceeded for a name that is too long for the tree.
nb::tuple names_of(const Options& options, nb::handle names, std::vector<std::string_view>& texts,
                   const char* field);
// An int as a stamp; kNoStamp for None.
Stamp stamp_of(nb::handle stamp, const char* field);
// A number of seconds, as yet of any sign.
double timeout_of(nb::handle timeout_s);
// A limit of gaps in ns, from one in seconds; kNoGapLimit for None.
Stamp max_gap_of(nb::handle max_gap_s);
// Exactly n numbers of a sequence.
void numbers_of(nb::handle values, double* out, Py_ssize_t n, const char* field);
Pose pose_of(nb::handle translation, nb::handle rotation);
// The question of an estimate, without its frames. The stamp None is `now`.
EstimateQuery estimate_query(nb::handle stamp, Stamp now, double level, Stamp max_by,
                             double radius);
// A C-contiguous float64 array, from an array of real numbers or nested sequences. Copies only
// where it must.
nb::object doubles_of(nb::handle values, const char* field);
// PySequence_Tuple, which keeps the items alive and unchanged.
nb::tuple tuple_of(nb::handle sequence);
// Calls body(stamped) for each item, which must be a StampedTransform.
template <class Body>
void for_each_stamped(const nb::tuple& items, Body&& body) {
  for (const nb::handle item : items) {
    if (!nb::isinstance<StampedTransform>(item))
      raise_invalid("stampeds must hold StampedTransforms", "stampeds");
    body(nb::cast<const StampedTransform&>(item));
  }
}
// --- arrays

template <class T>
using Column = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using PoseColumn = nb::ndarray<const double, nb::shape<-1, 7>, nb::c_contig, nb::device::cpu>;

template <class T>
std::span<const T> span_of(const Column<T>& column) {
  return {column.data(), column.shape(0)};
}
inline std::span<const Pose> span_of(const PoseColumn& poses) {
  static_assert(sizeof(Pose) == 7 * sizeof(double));
  return {reinterpret_cast<const Pose*>(poses.data()), poses.shape(0)};
}

// Raises unless the column has n rows, as those before it.
template <class AnyColumn>
void fit(const AnyColumn& column, std::size_t n, const char* field) {
  if (column.shape(0) != n)
    raise_invalid(std::string(field) + " has " + std::to_string(column.shape(0)) +
                      " rows, but the columns before it have " + std::to_string(n),
                  field);
}

// A numpy array that owns `storage`.
template <class T, std::size_t N>
nb::object array_of(std::unique_ptr<T[]> storage, const std::size_t (&shape)[N]) {
  T* const data = storage.get();
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  (void)storage.release();
  return nb::cast(nb::ndarray<nb::numpy, T>(data, N, shape, owner));
}

// A new numpy array; `fill` gets its storage.
template <class T, std::size_t N, class Fill>
nb::object make_array(const std::size_t (&shape)[N], Fill&& fill) {
  std::size_t size = 1;
  for (const std::size_t n : shape) size *= n;
  auto storage = std::make_unique_for_overwrite<T[]>(size);
  fill(storage.get());
  return array_of(std::move(storage), shape);
}

template <class T>
nb::object array_of(const std::vector<T>& values) {
  return make_array<T>({values.size()},
                       [&](T* out) { std::copy(values.begin(), values.end(), out); });
}

// --- the tree

template <auto function>
struct MethodOf {
  static constexpr auto* value = function;
};
template <class Result, class... Args, Result (*function)(const SharedTree&, Args...)>
struct MethodOf<function> {
  static nb::object call(const SharedTree& tree, Args... args) {
    try {
      return nb::cast(function(tree, args...));
    } catch (const Unanswered& unanswered) {
      return nb::cast(unanswered.reason);
    }
  }
  static constexpr auto* value = &call;
};
// A function of a tree as a method of its class. That of a tree in another process returns a member
// of AskServer if the function throws Unanswered.
template <auto function>
constexpr auto* method = MethodOf<function>::value;

// Tree::commit, with Rejected raised as its Python error. Releases the GIL if that pays.
void commit(Tree& tree, const CommitRequest& request, std::span<std::uint8_t> stored);

void bind_budget(nb::module_& m);
void bind_cdr(nb::module_& m);
void bind_columns(nb::module_& m);
void bind_join_buffers(nb::module_& m);
void bind_single_lookup(nb::module_& m);
void bind_transform(nb::module_& m);
void bind_transform_rows(nb::module_& m);
void bind_apply(nb::class_<Pose>& transform);
void bind_stamped(nb::module_& m);
void bind_estimate_class(nb::module_& m);
void bind_tree(nb::module_& m);
void bind_commit(nb::class_<Tree>& tree);
void bind_puts(nb::module_& m, nb::class_<Tree>& tree);
void bind_parked_lookups(nb::module_& m);
void bind_deskew(nb::module_& m);
void bind_change_log(nb::module_& m);
void bind_change_replay(nb::module_& m);
void bind_interest_reader(nb::module_& m);
void bind_operations(nb::module_& m);
void bind_shared_tree(nb::module_& m);
void bind_texts(nb::module_& m);

// What a tree of this process has, and one of another.
template <class AnyTree>
void bind_lookups(nb::class_<AnyTree>& tree);
template <class AnyTree>
void bind_lookup_columns(nb::class_<AnyTree>& tree);
template <class AnyTree>
void bind_read_rows(nb::class_<AnyTree>& tree);
template <class AnyTree>
void bind_introspection(nb::class_<AnyTree>& tree);
template <class AnyTree>
void bind_velocity(nb::class_<AnyTree>& tree);
template <class AnyTree>
void bind_estimate(nb::class_<AnyTree>& tree);
template <class AnyTree>
void bind_deskew(nb::class_<AnyTree>& tree);
template <class AnyTree>
void bind_reads(nb::class_<AnyTree>& tree) {
  bind_lookups(tree);
  bind_lookup_columns(tree);
  bind_read_rows(tree);
  bind_introspection(tree);
  bind_velocity(tree);
  bind_estimate(tree);
  bind_deskew(tree);
}

}  // namespace ztf
