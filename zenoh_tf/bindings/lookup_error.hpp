// The error of a lookup that failed: what it says beside its failure, and where that is found.
//
// Thread safety: requires the GIL.
#pragma once

#include "bindings/similar_names.hpp"

namespace ztf {

// What an error says of how its lookup was asked.
struct LookupNote {
  std::string waited = {};   // as of waited(); empty if the lookup did not wait
  std::string carried = {};  // appended to what was requested, of an estimate
  bool latest = false;       // no time was asked for: it failed at the latest common time
  bool may_wait = false;     // the method has a `timeout_s`
  bool suggest = true;       // the names that may be meant by one that does not exist
};

// The link that ends first of those between two frames.
struct EndedLink {
  std::string parent, child, authority;  // the last publisher's
  Stamp oldest, newest;
  bool was_static;  // before the last change
};

struct LookupError {
  const Failure& failure;
  const std::function<std::string(FrameId)> name_of;
  const std::uint32_t max_depth;
  const Startup startup;
  const nb::handle target, source;
  const LookupNote& note;
  const std::string suggestion;
  const std::optional<EndedLink> ended;
};
nb::object make_error(const LookupError& error);

// The dynamic link with the oldest newest sample, of those between two frames as they are now; none
// if they are not connected.
template <class AnyTree>
std::optional<EndedLink> find_ended_link(const AnyTree& tree, FrameId target, FrameId source) {
  std::vector<FrameId> frames;
  const Query newest_links{.op = Op::at, .target = target, .source = source};
  if (tree.chain(newest_links, frames).code != Code::ok) return std::nullopt;
  std::optional<EndedLink> ended;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const FrameInfo info = tree.info(frames[i]);
    const bool is_below = (i > 0 && info.parent == frames[i - 1]) ||
                          (i + 1 < frames.size() && info.parent == frames[i + 1]);
    if (!is_below || info.is_static || (ended && info.newest >= ended->newest)) continue;
    ended =
        EndedLink{.parent = tree.name(info.parent),
                  .child = tree.name(frames[i]),
                  .authority = std::string(tree.authority(info.authority)),
                  .oldest = info.oldest,
                  .newest = info.newest,
                  .was_static = info.change == FrameEvents::Change::switched && info.static_before};
  }
  return ended;
}

// The error of a lookup of `source` in `target`.
template <class AnyTree>
nb::object make_error(const AnyTree& tree, const Failure& failure, nb::handle target,
                      nb::handle source, const LookupNote& note = {}) {
  const bool is_unknown = failure.code == Code::lookup && failure.frame == 0;
  const bool has_no_data = failure.code == Code::backward || failure.code == Code::no_data;
  std::optional<EndedLink> ended;
  if (note.latest && has_no_data) ended = find_ended_link(tree, failure.target, failure.source);
  // The tree may have changed since.
  if (ended && ended->newest >= failure.oldest) ended.reset();
  return make_error(
      LookupError{.failure = failure,
                  .name_of = [&](FrameId id) { return tree.name(failure, id); },
                  .max_depth = tree.options().max_depth,
                  .startup = tree.startup(),
                  .target = target,
                  .source = source,
                  .note = note,
                  .suggestion = is_unknown && note.suggest
                                    ? did_you_mean(tree, {text_of(target, "target_frame"),
                                                          text_of(source, "source_frame")})
                                    : std::string(),
                  .ended = std::move(ended)});
}

}  // namespace ztf
