// StampedTransform and LatestTransform: answers of lookups, arguments of sets.
#include "bindings/transforms/transform.hpp"
#include "by_name/stamp_units.hpp"
#include "system/host.hpp"

namespace ztf {

namespace {

// True if a stamp may be a time from 2020 to 2100 in seconds, milliseconds or microseconds.
bool may_be_of_other_unit(Stamp stamp) noexcept {
  constexpr Stamp kFrom = 1'577'000'000, kTo = 4'103'000'000;  // seconds
  for (const Stamp unit : {Stamp{1}, Stamp{1'000}, Stamp{1'000'000}})
    if (kFrom * unit <= stamp && stamp <= kTo * unit) return true;
  return false;
}

// Warns of a stamp that is the clock's time in another unit.
[[gnu::noinline]] void check_unit(nb::handle child, Stamp stamp) {
  std::string name;
  block_if_thread_ends([&] {
    name = nb::cast<std::string>(nb::module_::import_("zenoh_tf.text").attr("quoted")(child));
  });
  const std::string text = unit_warning(name, stamp, real_time_ns());
  if (text.empty()) return;
  if (PyErr_WarnEx(PyExc_UserWarning, text.c_str(), 1) != 0) throw nb::python_error();
}

StampedTransform make_stamped(nb::handle parent, nb::handle child, nb::handle stamp,
                              const Pose& pose) {
  text_of(parent, "parent_frame");
  text_of(child, "child_frame");
  if (stamp.is_none()) raise_invalid("stamp_ns must be an int of nanoseconds", "stamp_ns");
  const Stamp value = stamp_of(stamp, "stamp_ns");
  if (may_be_of_other_unit(value)) [[unlikely]]
    check_unit(child, value);
  return {nb::borrow(parent), nb::borrow(child), value, pose};
}

bool equal(const StampedTransform& a, const StampedTransform& b) {
  return a.stamp == b.stamp && std::equal(&a.pose.x, &a.pose.x + 7, &b.pose.x) &&
         a.parent_frame.equal(b.parent_frame) && a.child_frame.equal(b.child_frame);
}

// The arguments that both constructors share, as eval() accepts them.
std::string repr_of_arguments(const StampedTransform& s) {
  return nb::cast<std::string>(nb::repr(s.parent_frame)) + ", " +
         nb::cast<std::string>(nb::repr(s.child_frame)) + ", stamp_ns=" + std::to_string(s.stamp) +
         ", transform=" + repr_of(s.pose);
}

void bind_stamped_transform(nb::module_& m) {
  nb::class_<StampedTransform>(m, "StampedTransform", nb::pooled(), docs::StampedTransform.text)
      .def(
          "__init__",
          [](StampedTransform* self, nb::handle parent, nb::handle child, nb::handle stamp,
             const Pose& transform, Stamp gap) {
            new (self) StampedTransform(make_stamped(parent, child, stamp, transform));
            self->gap = gap;
          },
          name_arg("parent_frame"), name_arg("child_frame"), nb::arg("stamp_ns").none(),
          nb::arg("transform"), nb::kw_only(), nb::arg("gap_ns") = 0)
      .def_ro("parent_frame", &StampedTransform::parent_frame,
              ZTF_PROPERTY_DOC(StampedTransform_parent_frame))
      .def_ro("child_frame", &StampedTransform::child_frame,
              ZTF_PROPERTY_DOC(StampedTransform_child_frame))
      .def_ro("stamp_ns", &StampedTransform::stamp, ZTF_PROPERTY_DOC(StampedTransform_stamp_ns))
      .def_prop_ro(
          "transform", [](const StampedTransform& s) { return s.pose; },
          ZTF_PROPERTY_DOC(StampedTransform_transform))
      .def_ro("gap_ns", &StampedTransform::gap, ZTF_PROPERTY_DOC(StampedTransform_gap_ns))
      .def(
          "__eq__",
          [](const StampedTransform& a, const StampedTransform& b) { return equal(a, b); },
          nb::is_operator())
      .def("__hash__",
           [](const StampedTransform& s) {
             return nb::hash(
                 nb::make_tuple(s.parent_frame, s.child_frame, s.stamp, numbers(&s.pose.x, 7)));
           })
      .def("__repr__",
           [](const StampedTransform& s) {
             return "StampedTransform(" + repr_of_arguments(s) +
                    (s.gap != 0 ? ", gap_ns=" + std::to_string(s.gap) : "") + ")";
           })
      .def("_repr_html_",
           [](nb::handle self) {
             return nb::module_::import_("zenoh_tf.notebook").attr("of_stamped")(self);
           })
      .def("__reduce__", [](nb::handle self) {
        const auto& s = nb::cast<const StampedTransform&>(self);
        nb::object make = nb::borrow(self.type());
        if (s.gap != 0)
          make = nb::module_::import_("functools").attr("partial")(make, nb::arg("gap_ns") = s.gap);
        return nb::make_tuple(make, nb::make_tuple(s.parent_frame, s.child_frame, s.stamp, s.pose));
      });
}

void bind_latest_transform(nb::module_& m) {
  nb::class_<LatestTransform, StampedTransform>(m, "LatestTransform", nb::pooled(),
                                                docs::LatestTransform.text)
      .def(
          "__init__",
          [](LatestTransform* self, nb::handle parent, nb::handle child, nb::handle stamp,
             const Pose& transform, nb::handle newest) {
            new (self) LatestTransform{make_stamped(parent, child, stamp, transform),
                                       stamp_of(newest, "newest_stamp_ns")};
          },
          name_arg("parent_frame"), name_arg("child_frame"), nb::arg("stamp_ns"),
          nb::arg("transform"), nb::arg("newest_stamp_ns"))
      .def_ro("newest_stamp_ns", &LatestTransform::newest,
              ZTF_PROPERTY_DOC(LatestTransform_newest_stamp_ns))
      .def(
          "__eq__",
          [](const LatestTransform& a, const LatestTransform& b) {
            return equal(a, b) && a.newest == b.newest;
          },
          nb::is_operator())
      .def("__hash__",
           [](const LatestTransform& s) {
             return nb::hash(nb::make_tuple(s.parent_frame, s.child_frame, s.stamp, s.newest));
           })
      .def("__repr__",
           [](const LatestTransform& s) {
             return "LatestTransform(" + repr_of_arguments(s) +
                    ", newest_stamp_ns=" + std::to_string(s.newest) + ")";
           })
      .def("__reduce__", [](nb::handle self) {
        const auto& s = nb::cast<const LatestTransform&>(self);
        return nb::make_tuple(
            self.type(), nb::make_tuple(s.parent_frame, s.child_frame, s.stamp, s.pose, s.newest));
      });
}

}  // namespace

void bind_stamped(nb::module_& m) {
  bind_stamped_transform(m);
  bind_latest_transform(m);
}

}  // namespace ztf
