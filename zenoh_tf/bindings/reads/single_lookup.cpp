// The messages of a lookup of one row. Where a function returns None, the general one of
// zenoh_tf/wire takes the message: it is of another form, or fails.
//
// GIL: kept, as in tree.cpp.
#include "messages/single_lookup.hpp"

#include "bindings/bindings.hpp"

namespace ztf {

namespace {

nb::object pack_lookup(nb::handle target, nb::handle source, std::uint8_t op, Stamp stamp) {
  const std::string_view target_name = text_of(target, "target_frame"),
                         source_name = text_of(source, "source_frame");
  return bytes_of(pack_single_lookup({target_name, source_name, static_cast<Op>(op), stamp}));
}

nb::object reply_to_lookup(const Tree& tree, const nb::bytes& message, std::string_view instance) {
  const auto lookup = parse_single_lookup(view_of(message));
  if (!lookup || lookup->op > Op::latest_xact ||
      (lookup->op == Op::at && lookup->stamp == kNoStamp))
    return nb::none();
  NamedQuery query{{.op = lookup->op, .stamp = lookup->stamp}, lookup->target, lookup->source};
  Answer answer;
  {
    const GilReleasedOnWait released;
    ztf::lookup(tree, query, answer);
  }
  if (answer.failure.code != Code::ok || answer.gap != 0) return nb::none();
  SingleAnswer reply{answer.stamp, {}, answer.pose};
  if (lookup->op >= Op::latest) reply.newest = answer.newest;
  return bytes_of(pack_single_answer(reply, instance));
}

nb::object parse_answer(const nb::bytes& reply, std::string_view instance) {
  const auto answer = parse_single_answer(view_of(reply), instance);
  if (!answer) return nb::none();
  return nb::make_tuple(answer->stamp, answer->newest.value_or(answer->stamp), answer->pose);
}

}  // namespace

void bind_single_lookup(nb::module_& m) {
  m.def("pack_single_lookup", &pack_lookup, name_arg("target"), name_arg("source"), nb::arg("op"),
        nb::arg("stamp_ns"));
  m.def("reply_to_lookup", &reply_to_lookup, nb::arg("tree"), nb::arg("message"),
        nb::arg("instance"));
  m.def("parse_single_answer", &parse_answer, nb::arg("reply"), nb::arg("instance"));
}

}  // namespace ztf
