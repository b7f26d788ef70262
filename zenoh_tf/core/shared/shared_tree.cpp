// The reads of a shared tree.
#include "shared/shared_tree.hpp"

#include "shared/transaction.hpp"
#include "system/host.hpp"

namespace ztf {

SharedTree::SharedTree(int descriptor)
    : region_(descriptor),
      memory_(region_.header(), region_.file(), options().max_name_bytes),
      frames_(
          region_.array<Frame>(region_.header().frames, std::uint64_t{options().max_ids()} + 1)),
      events_(region_.array<FrameEvents>(region_.header().events,
                                         std::uint64_t{options().max_ids()} + 1)),
      names_(checked(region_, region_.header().names, options().max_ids(), memory_)),
      authorities_(
          checked(region_, region_.header().authorities, options().max_authorities, memory_)),
      max_depth_(options().max_path()),
      ever_reparented_(region_.header().ever_reparented),
      ids_freed_(region_.header().ids_freed) {}

SharedTree::Names SharedTree::checked(const MappedRegion& region, const NameRoot& root,
                                      std::uint32_t max_names, const MappedMemory& memory) {
  const Names names(root, max_names, memory);
  (void)region.array<NameEntry>(memory.distance(names.entries()), std::uint64_t{max_names} + 1);
  return names;
}

std::string SharedTree::name_in(const Names& names, NameId id) {
  std::string text;
  if (!names.read_name(id, text)) throw Unanswered{Unanswered::Reason::busy};
  return text;
}

void SharedTree::check_lease() const {
  // A tenth of the time, but late by a tick, or by more where a host takes processors away from a
  // virtual machine. So it decides only where much of the lease is left.
  constexpr std::int64_t kMargin = 100'000'000;
  // The differences cannot overflow, whatever the region says: the clock is not negative.
  const std::int64_t now = coarse_monotonic_ns(), end = lease_ns();
  if (now < end && end - now > kMargin) [[likely]]
    return;
  if (monotonic_ns() >= lease_ns()) throw Unanswered{Unanswered::Reason::lapsed};
}

ZTF_MULTIVERSION void SharedTree::lookup(const Query& query, Answer& answer) const {
  // A `full` lookup takes two walks one after the other, which a WalkGuard cannot validate
  // together.
  if (query.op == Op::full) {
    ReadSet reads;
    return read(reads, [&](auto& reader) { return reader.answer(query, answer); });
  }
  const auto attempt = [&](const MappedFrames& frames, Patience& patience)
                           __attribute__((always_inline)) {
                             PatientWalkGuard guard(patience);
                             return reader_of(frames, guard).answer(query, answer);
                           };
  if (!try_read(kSharedAttempts, attempt)) throw Unanswered{Unanswered::Reason::busy};
}

void SharedTree::lookup_transaction(std::span<const Query> queries, std::span<Answer> answers,
                                    ReadSet& reads, std::size_t max_reads) const {
  read(reads, [&](auto& reader) { return answer_all(reader, queries, answers, reads, max_reads); });
}

Failure SharedTree::chain(const Query& query, std::vector<FrameId>& frames) const {
  ReadSet reads;
  Answer answer;
  read(reads, [&](auto& reader) { return reader.chain(query, frames, answer); });
  return answer.failure;
}

std::vector<NamedInfo> SharedTree::ancestors(std::span<const FrameId> starts, Stamp stamp) const {
  ReadSet reads;
  std::vector<NamedInfo> found;
  read(reads, [&](auto& reader) { return list_ancestors(reader, starts, stamp, events_, found); });
  return found;
}

FrameId SharedTree::parent(FrameId id, Stamp stamp) const {
  return read_frame<FrameId>(id, [&](const MappedFrames& frames, const Frame& frame, Version) {
    return parent_of(frames, frame, stamp);
  });
}

FrameInfo SharedTree::info(FrameId id) const {
  return read_frame<FrameInfo>(id, [&](const MappedFrames&, const Frame& frame, Version version) {
    return info_of(frame, events_[id], version);
  });
}

}  // namespace ztf
