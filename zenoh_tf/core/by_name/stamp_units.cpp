#include "by_name/stamp_units.hpp"

#include <cmath>
#include <cstdio>
#include <utility>

#include "system/host.hpp"

namespace ztf {

namespace {

constexpr double kNsPerSecond = 1e9, kMinute = 60e9, kHour = 3600e9, kDay = 24 * kHour;
// Stamps after 1973 are of a real clock.
constexpr Stamp kReal = 100'000'000'000'000'000;
// Sensors without a clock count from 1970, or from 1980 as GPS does. This is in 2001.
constexpr Stamp kSensor = 1'000'000'000'000'000'000;
// How far a stamp of simulated time may be from the others, if it is read in another unit. A stamp
// farther than a day from a real clock counts as of another one.
constexpr double kSimulatedMargin = 60e9, kRealMargin = kDay;
// A forward lookup that misses by less is probably one of the present.
constexpr double kPresent = 2e9;
// TAI is so far ahead of UTC, since 2017; and how far a sensor's sample is from the link's newest.
constexpr double kTai = 37e9, kTaiMargin = 0.5e9;
// Units that a stamp may be in by mistake.
constexpr std::pair<const char*, double> kUnits[] = {
    {"seconds", 1e9}, {"milliseconds", 1e6}, {"microseconds", 1e3}};

constexpr const char* kCure =
    ": stamps are integer nanoseconds, such as time.time_ns() or round(seconds * 1e9)";

// Of any two stamps, whose difference a Stamp may not hold.
double span(Stamp from, Stamp to) noexcept {
  if (to < from) return -span(to, from);
  return static_cast<double>(static_cast<std::uint64_t>(to) - static_cast<std::uint64_t>(from));
}

std::string printed(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string after_1970(Stamp stamp, const char* unit) {
  return age(static_cast<double>(stamp)) + " after 1970, and looks like " + unit;
}

std::string looks_like(Stamp stamp, const char* unit) {
  return std::to_string(stamp) + " ns is " + after_1970(stamp, unit) + kCure;
}

std::string of_its_own_clock(Stamp stamp) {
  return age(static_cast<double>(stamp)) +
         " after 1970, as of a simulation, or of a sensor that counts from its start: give all one "
         "clock";
}

// What is wrong if either a lookup's stamp or its link's stamps are in another unit or of another
// clock, and the others are of a real clock; else empty.
std::string unit_hint(Stamp stamp, Stamp oldest, Stamp newest) {
  if (newest > kReal) {
    const Stamp now = real_time_ns();  // an old recording is asked for the present, too
    const char* unit = other_unit(stamp, oldest, newest);
    if (!unit) unit = other_unit(stamp, now, now);
    if (unit) return looks_like(stamp, unit);
  } else if (stamp > kReal && newest % 1000 != 0) {  // as of unit_warning
    if (const char* const unit = other_unit(newest, stamp, stamp))
      return "the link's newest stamp of " + looks_like(newest, unit);
  }
  if (0 < stamp && stamp < kSensor && kSensor < newest) return "that is " + of_its_own_clock(stamp);
  if (0 < newest && newest < kSensor && kSensor < stamp)
    return "the link's newest stamp is " + of_its_own_clock(newest);
  return "";
}

}  // namespace

std::string age(double length_ns) {
  const std::string sign = length_ns < 0 ? "-" : "";
  const double value = std::abs(length_ns);
  if (value < 1e6) return sign + printed("%.0f us", std::floor(value / 1e3));
  if (value < kNsPerSecond) return sign + printed("%.0f ms", value / 1e6);
  if (value < 2 * kMinute) return sign + printed("%.1f s", value / kNsPerSecond);
  if (value < 2 * kHour) return sign + printed("%.0f min", value / kMinute);
  if (value < 100 * kHour) return sign + printed("%.1f h", value / kHour);
  const double days = value / kDay;
  return sign +
         (days < 2 * 365 ? printed("%.1f days", days) : printed("%.1f years", days / 365.25));
}

const char* other_unit(Stamp stamp, Stamp oldest, Stamp newest) noexcept {
  const auto value = static_cast<double>(stamp);
  const auto first = static_cast<double>(oldest), last = static_cast<double>(newest);
  if (stamp <= 0 || value * 100 >= first) return nullptr;
  const double margin = newest > kReal ? kRealMargin : kSimulatedMargin;
  for (const auto& [unit, ns] : kUnits)
    if (first - margin <= value * ns && value * ns <= last + margin) return unit;
  return nullptr;
}

std::string unit_warning(const std::string& quoted_child, Stamp stamp, Stamp now) {
  const char* const unit = other_unit(stamp, now, now);
  if (!unit || stamp % 1000 == 0) return "";
  // Without the number: Python shows each text once.
  return "the stamp of " + quoted_child + " is " + after_1970(stamp, unit) + kCure;
}

std::string beside(Stamp stamp, Stamp oldest, Stamp newest, const std::string& waited,
                   bool may_wait) {
  const bool is_late = stamp > newest;
  const double off = is_late ? span(newest, stamp) : span(stamp, oldest);
  std::string end = " (" + age(off) + (is_late ? " too late" : " too early");
  end += (waited.empty() ? "" : ", " + waited) + ")";
  std::string hint = unit_hint(stamp, oldest, newest);
  if (hint.empty() && is_late && newest > kReal && std::abs(off - kTai) < kTaiMargin)
    hint = "TAI, the time of PTP, is 37 s ahead of UTC";
  if (hint.empty() && may_wait && waited.empty() && is_late && off <= kPresent)
    hint = "give the lookup a time-out to wait for the next sample";
  return hint.empty() ? end : end + "; " + hint;
}

std::string ended(Stamp newest, Stamp oldest, Stamp now, const std::string& failing,
                  const std::string& change) {
  const double ago = span(newest, now);
  const std::string hint = unit_hint(newest, oldest, oldest);
  return ", which is " + (0 <= ago && ago <= kDay ? age(ago) + " ago and " : "") +
         age(span(newest, oldest)) + " before the oldest sample of " + failing + change +
         (hint.empty() ? "" : "; " + hint);
}

}  // namespace ztf
