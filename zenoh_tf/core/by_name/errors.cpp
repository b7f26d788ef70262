#include "by_name/errors.hpp"

#include <algorithm>
#include <cstdio>

#include "by_name/similar.hpp"
#include "by_name/stamp_units.hpp"
#include "shared/shared_tree.hpp"
#include "system/host.hpp"
#include "tree.hpp"

namespace ztf {

namespace {

// When to ask again for a frame of a server that has just started.
constexpr double kRetryAfterS = 0.1;
constexpr std::size_t kMaxQuoted = 64;  // bytes of a name in an error about its length
// How many of a tree's names an error compares. That takes about 0.1 ms, and everybody may ask for
// a frame that does not exist.
constexpr std::size_t kMostCompared = 1000;
// Among so many ids: those of removed frames are passed over.
constexpr FrameId kMostVisited = 16'000;

// The link that ends first of those between two frames.
struct EndedLink {
  std::string parent, child, authority;  // the last publisher's
  Stamp oldest, newest;
  bool was_static;  // before the last change
};

std::string ns(Stamp stamp) { return std::to_string(stamp) + " ns"; }

template <class... Value>
std::string formatted(const char* format, Value... value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value...);
  return text;
}

std::string seconds(Stamp duration) {
  return formatted("%.9g s", static_cast<double>(duration) * 1e-9);
}

// A frame of a failure, which may have lost its name.
std::string frame_text(const std::string& name) {
  return name.empty() ? "a removed frame" : quoted(name);
}

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

// What is wrong with the link that has no data at the stamp asked for.
std::string extrapolation_message(const Failure& f, const std::string& link) {
  if (f.code == Code::gap)
    return "gap: " + link + " has no sample for " + seconds(f.newest - f.oldest) + ", from " +
           ns(f.oldest) + " to " + ns(f.newest) +
           (f.max_gap >= 0 ? ", and the limit is " + seconds(f.max_gap) + " (max_gap_s)"
                           : ", which is much longer than usual (max_gap_s allows it)");
  if (f.code == Code::no_data)
    return "extrapolation: " + link + " has a single sample, at " + ns(f.newest);
  const std::string range = link + " has samples from " + ns(f.oldest) + " to " + ns(f.newest);
  return f.code == Code::forward ? "extrapolation into the future: " + range
                                 : "extrapolation into the past: " + range;
}

// The message of a lookup without a time: the links have no time in common, as one has ended before
// the failing one begins.
std::string no_common_time(const Failure& f, const EndedLink& link, const Rejected& error,
                           const std::string& failing) {
  std::string change;
  if (link.was_static)
    change = "; it was static until " +
             (link.authority.empty() ? "a publisher without a name" : quoted(link.authority)) +
             " sent it as moving";
  return "extrapolation: the links between " + quoted(error.target) + " and " +
         quoted(error.source) + " have no time in common: the link from " +
         frame_text(link.parent) + " to " + frame_text(link.child) + " has no sample after " +
         ns(link.newest) + ended(link.newest, f.oldest, real_time_ns(), failing, change);
}

// "the server was started ... ago".
std::string was_started(Startup startup) {
  return "the server was started " +
         formatted("%.1f s", static_cast<double>(startup.elapsed_ns) * 1e-9) + " ago";
}

// Sets `frame`, code and message of the error of a frame that is not there.
void set_unknown(Rejected& error, Startup startup, std::string_view name, const std::string& waited,
                 const std::string& suggestion) {
  const std::string frame = "frame " + quoted(name);
  error.frame = name;
  if (startup.is_over()) {
    error.code = Code::lookup;
    error.message = frame + " does not exist" + waited + suggestion;
    return;
  }
  error.code = Code::starting;
  error.retry_after_s = kRetryAfterS;
  error.message = was_started(startup) + " and has no " + frame + " yet" + waited +
                  ": its publisher may be coming back; try again, or wait with a time-out";
}

// Sets the facts and the message of a link that has no data for the time asked for.
template <class AnyTree>
void set_extrapolation(const AnyTree& tree, const Failure& f, const LookupNote& note, bool latest,
                       const std::string& waited, Rejected& error) {
  error.frame = tree.name(f, f.frame), error.parent = tree.name(f, f.parent);
  error.oldest = f.oldest, error.newest = f.newest;
  const std::string link =
      "the link from " + frame_text(error.parent) + " to " + frame_text(error.frame);
  const bool has_no_data = f.code == Code::backward || f.code == Code::no_data;
  std::optional<EndedLink> ended;
  if (latest && has_no_data) ended = find_ended_link(tree, f.target, f.source);
  if (ended && ended->newest < f.oldest) {  // otherwise the tree has changed since
    error.message = no_common_time(f, *ended, error, link) + waited;
    error.frame = ended->child, error.parent = ended->parent;
    error.oldest = ended->oldest, error.newest = ended->newest;
    return;
  }
  std::string carried;
  if (f.code == Code::forward && note.max_by >= 0)
    carried = " and carried on by at most " + seconds(note.max_by) + " (max_by_s)";
  const bool may_wait = note.may_wait && !tree.is_recorded();
  error.message =
      extrapolation_message(f, link) + ", but " + ns(f.stamp) + " was requested to look up " +
      quoted(error.source) + " in " + quoted(error.target) + carried +
      (f.code == Code::gap ? waited : beside(f.stamp, f.oldest, f.newest, note.waited, may_wait));
  if (f.code != Code::gap) return;
  error.gap = f.newest - f.oldest;
  error.max_gap = f.max_gap;
}

}  // namespace

std::string waited_for(double timeout_s) {
  return "waited for " + age(std::min(timeout_s, 1e9) * 1e9);
}

std::optional<Rejected> name_fault(std::string_view name, const char* field) {
  if (is_frame_name(name)) return std::nullopt;
  if (name.empty())
    return Rejected{.code = Code::invalid_argument,
                    .message = std::string(field) + " is empty",
                    .field = field};
  const std::string_view rest = name.substr(std::min(name.find_first_not_of('/'), name.size()));
  return Rejected{.code = Code::invalid_argument,
                  .message = std::string(field) +
                             ": frame names do not begin with '/': " + quoted(name) +
                             (rest.empty() ? " is no frame's name" : " is spelled " + quoted(rest)),
                  .frame = std::string(name),
                  .field = field};
}

void check_name_bytes(const Options& options, std::span<const std::string_view> names) {
  // A commit strips one '/' in front.
  const std::size_t most = std::size_t{options.max_name_bytes} + 1;
  for (const std::string_view name : names) {
    if (name.size() <= most) [[likely]]
      continue;
    std::size_t end = kMaxQuoted;
    while (end > 0 && (static_cast<unsigned char>(name[end]) & 0xc0) == 0x80) --end;
    throw Rejected{.code = Code::limit,
                   .message = "the name " + quoted(std::string(name.substr(0, end)) + "...") +
                              " has " + std::to_string(name.size()) + " bytes: the limit is " +
                              std::to_string(options.max_name_bytes) + " (max_name_bytes)",
                   .field = "max_name_bytes",
                   .limit = options.max_name_bytes,
                   .value = static_cast<std::int64_t>(name.size())};
  }
}

template <class AnyTree>
std::string suggestion(const AnyTree& tree, std::initializer_list<std::string_view> asked) {
  std::vector<std::string> unknown, names;
  for (const std::string_view name : asked)
    if (tree.find(name) == 0 && std::ranges::find(unknown, name) == unknown.end())
      unknown.emplace_back(name);
  const FrameId last = std::min(tree.size(), kMostVisited);
  for (FrameId id = 1; id <= last && names.size() < kMostCompared; ++id)
    if (!tree.removed(id)) names.push_back(tree.name(id));
  const std::string question = did_you_mean(unknown, names);
  return question.empty() ? "" : "; " + question;
}

template <class AnyTree>
Rejected unknown_frame(const AnyTree& tree, std::string_view name) {
  Rejected error{};
  set_unknown(error, tree.startup(), name, "", suggestion(tree, {name}));
  return error;
}

template <class AnyTree>
Rejected lookup_error(const AnyTree& tree, const Failure& f, std::string_view target,
                      std::string_view source, const LookupNote& note, bool latest) {
  Rejected error{.code = f.code, .message = {}, .stamp = f.stamp};
  error.target = target, error.source = source;
  const std::string at = f.stamp == kNoStamp ? "" : " at " + ns(f.stamp);
  const std::string waited = note.waited.empty() ? "" : " (" + note.waited + ")";
  if (is_unknown(f)) {
    set_unknown(error, tree.startup(), f.target == 0 ? target : source, waited,
                note.suggest ? suggestion(tree, {target, source}) : "");
  } else if (f.code == Code::lookup) {
    error.frame = tree.name(f, f.frame);
    error.message = "the path between " + quoted(target) + " and " + quoted(source) + at;
    if (const std::uint32_t max_depth = tree.options().max_depth; max_depth != 0) {
      error.limit = max_depth;
      error.message += " is longer than the limit of " + std::to_string(max_depth) +
                       " links per side (max_depth), or";
    }
    error.message += " runs in a loop" + waited;
  } else if (f.code == Code::connectivity) {
    error.target_root = tree.name(f, f.target_root);
    error.source_root = tree.name(f, f.source_root);
    error.message = quoted(target) + " and " + quoted(source) + " are not connected" + at +
                    ": their roots are " + frame_text(error.target_root) + " and " +
                    frame_text(error.source_root) + waited;
    if (const Startup startup = tree.startup(); !startup.is_over()) {
      error.retry_after_s = kRetryAfterS;
      error.message += "; " + was_started(startup) + ": the publisher of a link may be coming back";
    }
  } else {
    set_extrapolation(tree, f, note, latest, waited, error);
  }
  return error;
}

template <class AnyTree>
Rejected lookup_error(const AnyTree& tree, const Failure& failure, const NamedQuery& query,
                      const LookupNote& note) {
  if (query.op != Op::full)
    return lookup_error(tree, failure, query.target_name, query.source_name, note,
                        query.op == Op::latest_common);
  // It failed in one of its halves: source in fixed, or fixed in target.
  const bool first = failure.source_half;
  return lookup_error(tree, failure, first ? query.fixed_name : query.target_name,
                      first ? query.source_name : query.fixed_name, note,
                      (first ? query.source_stamp : query.stamp) == kNoStamp);
}

#define ZTF_OF_TREE(AnyTree)                                                                \
  template std::string suggestion(const AnyTree&, std::initializer_list<std::string_view>); \
  template Rejected unknown_frame(const AnyTree&, std::string_view);                        \
  template Rejected lookup_error(const AnyTree&, const Failure&, std::string_view,          \
                                 std::string_view, const LookupNote&, bool);                \
  template Rejected lookup_error(const AnyTree&, const Failure&, const NamedQuery&,         \
                                 const LookupNote&);
ZTF_OF_TREE(Tree)
ZTF_OF_TREE(SharedTree)
#undef ZTF_OF_TREE

}  // namespace ztf
