// GIL: required.
#include "bindings/replication/message_columns.hpp"

#include <bit>

namespace ztf {

namespace {

static_assert(std::endian::native == std::endian::little);
static_assert(sizeof(ChangeKind) == 1);
static_assert(sizeof(Pose) == 7 * sizeof(double) && alignof(Pose) == alignof(double));

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

template <class Columns, class Table>
void fill(Columns& columns, const Table& table) {
  columns.names = texts_of(table.names);
  columns.authorities = texts_of(table.authorities);
  Columns::each_column([&](const char*, auto column, auto of_table) {
    const auto& values = table.*of_table;
    columns.*column = nb::bytes(values.data(), values.size() * sizeof(values[0]));
  });
}

template <class Columns>
nb::dict fields_of(const Columns& columns) {
  nb::dict out;
  out["names"] = columns.names;
  out["authorities"] = columns.authorities;
  Columns::each_column([&](const char* name, auto column, auto) { out[name] = columns.*column; });
  return out;
}

// A column as an array, which keeps its bytes alive.
template <class T>
nb::object array_of(const nb::bytes& column) {
  using Number = std::conditional_t<std::is_enum_v<T>, std::uint8_t,
                                    std::conditional_t<std::is_same_v<T, Pose>, double, T>>;
  const std::size_t shape[] = {column.size() / sizeof(T), sizeof(T) / sizeof(Number)};
  const std::size_t dimensions = shape[1] == 1 ? 1 : 2;
  return nb::cast(nb::ndarray<nb::numpy, const Number>(column.c_str(), dimensions, shape, column));
}

template <class Columns>
void bind(nb::module_& m, const char* name, const char* doc) {
  auto type = nb::class_<Columns>(m, name, doc)
                  .def(nb::init<const nb::dict&>(), nb::arg("message"))
                  .def("fields", &Columns::fields)
                  .def_ro("names", &Columns::names)
                  .def_ro("authorities", &Columns::authorities);
  Columns::each_column([&]<class Table, class T>(const char* field, nb::bytes Columns::* column,
                                                 std::vector<T> Table::*) {
    type.def_prop_ro(field, [column](const Columns& self) { return array_of<T>(self.*column); });
  });
}

}  // namespace

Changes::Changes(const ChangeTable& table) { fill(*this, table); }

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
  nb::dict out = fields_of(*this);
  if (lost.size() == 0) nb::del(out["lost"]);  // names lose their ids only at the limit of frames
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

Frames::Frames(const FrameTable& table) { fill(*this, table); }

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

nb::dict Frames::fields() const { return fields_of(*this); }

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
  bind<Changes>(m, "Changes", "What commits have changed, as columns.");
  bind<Frames>(m, "Frames", "Frames with their histories, as columns.");
}

}  // namespace ztf
