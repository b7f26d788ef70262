// GIL: required.
#include "bindings/replication/message_columns.hpp"

#include <bit>

namespace ztf {

namespace {

static_assert(std::endian::native == std::endian::little);
static_assert(sizeof(ChangeKind) == 1);
static_assert(sizeof(Pose) == 7 * sizeof(double) && alignof(Pose) == alignof(double));

template <class T>
nb::bytes bytes_of(const std::vector<T>& column) {
  return nb::bytes(column.data(), column.size() * sizeof(T));
}

// CPython puts the bytes behind a header of 32 bytes, so they are aligned for numbers of 8.
template <class T>
std::span<const T> values_of(const nb::bytes& column) {
  return {reinterpret_cast<const T*>(column.c_str()), column.size() / sizeof(T)};
}

nb::tuple texts_of(std::span<const std::string_view> texts) {
  nb::list out;
  for (const std::string_view text : texts) out.append(str_of(text));
  return tuple_of(out);
}

[[noreturn]] void raise_malformed(const char* field, const std::string& expected) {
  const nb::object malformed = nb::module_::import_("zenoh_tf.wire.fields").attr("malformed");
  raise(malformed(field, expected));
}

nb::tuple texts_field(const nb::dict& message, const char* field) {
  const nb::object value = message.get(field, nb::none());
  if (!PyList_CheckExact(value.ptr())) raise_malformed(field, "a list of texts");
  nb::tuple texts = tuple_of(value);
  for (const nb::handle text : texts)
    if (!PyUnicode_CheckExact(text.ptr())) raise_malformed(field, "a list of texts");
  return texts;
}

// A column of `rows` entries.
template <class T>
nb::bytes column_field(const nb::dict& message, const char* field,
                       std::optional<std::size_t> rows = {}) {
  const nb::object value = message.get(field, nb::none());
  if (!PyBytes_CheckExact(value.ptr())) raise_malformed(field, "binary");
  nb::bytes column = nb::borrow<nb::bytes>(value);
  const std::size_t size = column.size(), n = size / sizeof(T);
  if (size != n * sizeof(T))
    raise_malformed(field, "a multiple of " + std::to_string(sizeof(T)) + " bytes, not " +
                               std::to_string(size));
  if (rows && n != *rows)
    raise_malformed(field, std::to_string(*rows) + " rows, not " + std::to_string(n));
  return column;
}

// The same, of indexes into a list of `size` entries. `none`: an index that refers to nothing.
nb::bytes index_field(const nb::dict& message, const char* field, std::optional<std::size_t> rows,
                      std::size_t size, std::optional<std::uint32_t> none = {}) {
  nb::bytes column = column_field<std::uint32_t>(message, field, rows);
  for (const std::uint32_t index : values_of<std::uint32_t>(column))
    if (index >= size && index != none)
      raise_malformed(field, "indexes below " + std::to_string(size) +
                                 (none ? ", or " + std::to_string(*none) : "") + ", not " +
                                 std::to_string(index));
  return column;
}

// A column as an array, which keeps its bytes alive.
template <class T, auto member>
void def_column(auto& type, const char* name) {
  type.def_prop_ro(name, [](const typename std::decay_t<decltype(type)>::Type& self) {
    const nb::bytes& column = self.*member;
    if constexpr (std::is_same_v<T, Pose>) {
      const std::size_t shape[] = {column.size() / sizeof(Pose), 7};
      return nb::cast(nb::ndarray<nb::numpy, const double>(column.c_str(), 2, shape, column));
    } else {
      const std::size_t shape[] = {column.size() / sizeof(T)};
      return nb::cast(nb::ndarray<nb::numpy, const T>(column.c_str(), 1, shape, column));
    }
  });
}

}  // namespace

Changes::Changes(const ChangeTable& t)
    : names(texts_of(t.names)),
      authorities(texts_of(t.authorities)),
      kind(bytes_of(t.kind)),
      frame(bytes_of(t.frame)),
      version(bytes_of(t.version)),
      parent(bytes_of(t.parent)),
      authority(bytes_of(t.authority)),
      stamp(bytes_of(t.stamp)),
      pose(bytes_of(t.pose)),
      lost(bytes_of(t.lost)) {}

Changes::Changes(const nb::dict& message)
    : names(texts_field(message, "names")),
      authorities(texts_field(message, "authorities")),
      kind(column_field<std::uint8_t>(message, "kind")),
      lost("", 0) {
  std::size_t samples = 0, orphaned = 0;
  constexpr auto kLast = static_cast<std::uint8_t>(ChangeKind::orphaned);
  for (const std::uint8_t each : values_of<std::uint8_t>(kind)) {
    if (each > kLast) raise_malformed("kind", "at most " + std::to_string(kLast));
    samples += has_sample(static_cast<ChangeKind>(each));
    orphaned += each == kLast;
  }
  const std::size_t n = kind.size();
  frame = index_field(message, "frame", n, names.size());
  version = column_field<Version>(message, "version", n);
  parent = index_field(message, "parent", samples, names.size(), kNoParent);
  authority = index_field(message, "authority", samples, authorities.size());
  stamp = column_field<Stamp>(message, "stamp", samples);
  pose = column_field<Pose>(message, "pose", samples);
  if (orphaned != 0) lost = index_field(message, "lost", orphaned, names.size(), kNoParent);
}

nb::dict Changes::fields() const {
  nb::dict out;
  out["names"] = names;
  out["authorities"] = authorities;
  out["kind"] = kind;
  out["frame"] = frame;
  out["version"] = version;
  out["parent"] = parent;
  out["authority"] = authority;
  out["stamp"] = stamp;
  out["pose"] = pose;
  if (lost.size() != 0) out["lost"] = lost;  // names lose their ids only at the limit of frames
  return out;
}

ChangeColumns Changes::view(std::span<const std::string_view> name_texts,
                            std::span<const std::string_view> authority_texts) const {
  return {name_texts,
          authority_texts,
          values_of<ChangeKind>(kind),
          values_of<std::uint32_t>(frame),
          values_of<Version>(version),
          values_of<std::uint32_t>(parent),
          values_of<std::uint32_t>(authority),
          values_of<Stamp>(stamp),
          values_of<Pose>(pose),
          values_of<std::uint32_t>(lost)};
}

Frames::Frames(const FrameTable& t)
    : names(texts_of(t.names)),
      authorities(texts_of(t.authorities)),
      frame(bytes_of(t.frame)),
      version(bytes_of(t.version)),
      is_static(bytes_of(t.is_static)),
      authority(bytes_of(t.authority)),
      count(bytes_of(t.count)),
      stamp(bytes_of(t.stamp)),
      parent(bytes_of(t.parent)),
      pose(bytes_of(t.pose)) {}

Frames::Frames(const nb::dict& message)
    : names(texts_field(message, "names")),
      authorities(texts_field(message, "authorities")),
      frame(index_field(message, "frame", {}, names.size())) {
  const std::size_t n = values_of<std::uint32_t>(frame).size();
  version = column_field<Version>(message, "version", n);
  is_static = column_field<std::uint8_t>(message, "static", n);
  authority = index_field(message, "authority", n, authorities.size());
  count = column_field<std::uint32_t>(message, "count", n);
  std::size_t samples = 0;
  for (const std::uint32_t each : values_of<std::uint32_t>(count)) samples += each;
  stamp = column_field<Stamp>(message, "stamp", samples);
  parent = index_field(message, "parent", samples, names.size(), kNoParent);
  pose = column_field<Pose>(message, "pose", samples);
}

nb::dict Frames::fields() const {
  nb::dict out;
  out["names"] = names;
  out["authorities"] = authorities;
  out["frame"] = frame;
  out["version"] = version;
  out["static"] = is_static;
  out["authority"] = authority;
  out["count"] = count;
  out["stamp"] = stamp;
  out["parent"] = parent;
  out["pose"] = pose;
  return out;
}

FrameColumns Frames::view(std::span<const std::string_view> name_texts,
                          std::span<const std::string_view> authority_texts) const {
  return {name_texts,
          authority_texts,
          values_of<std::uint32_t>(frame),
          values_of<Version>(version),
          values_of<std::uint8_t>(is_static),
          values_of<std::uint32_t>(authority),
          values_of<std::uint32_t>(count),
          values_of<Stamp>(stamp),
          values_of<std::uint32_t>(parent),
          values_of<Pose>(pose)};
}

void bind_message_columns(nb::module_& m) {
  auto changes = nb::class_<Changes>(m, "Changes", "What commits have changed, as columns.")
                     .def(nb::init<const nb::dict&>(), nb::arg("message"))
                     .def("fields", &Changes::fields)
                     .def_ro("names", &Changes::names)
                     .def_ro("authorities", &Changes::authorities);
  def_column<std::uint8_t, &Changes::kind>(changes, "kind");
  def_column<std::uint32_t, &Changes::frame>(changes, "frame");
  def_column<Version, &Changes::version>(changes, "version");
  def_column<std::uint32_t, &Changes::parent>(changes, "parent");
  def_column<std::uint32_t, &Changes::authority>(changes, "authority");
  def_column<Stamp, &Changes::stamp>(changes, "stamp");
  def_column<Pose, &Changes::pose>(changes, "pose");
  def_column<std::uint32_t, &Changes::lost>(changes, "lost");
  auto frames = nb::class_<Frames>(m, "Frames", "Frames with their histories, as columns.")
                    .def(nb::init<const nb::dict&>(), nb::arg("message"))
                    .def("fields", &Frames::fields)
                    .def_ro("names", &Frames::names)
                    .def_ro("authorities", &Frames::authorities);
  def_column<std::uint32_t, &Frames::frame>(frames, "frame");
  def_column<Version, &Frames::version>(frames, "version");
  def_column<std::uint8_t, &Frames::is_static>(frames, "static");
  def_column<std::uint32_t, &Frames::authority>(frames, "authority");
  def_column<std::uint32_t, &Frames::count>(frames, "count");
  def_column<Stamp, &Frames::stamp>(frames, "stamp");
  def_column<std::uint32_t, &Frames::parent>(frames, "parent");
  def_column<Pose, &Frames::pose>(frames, "pose");
}

}  // namespace ztf
