// Arrays take no memory for pages that nobody has touched.
#include <sys/mman.h>
#include <unistd.h>

#include <vector>

#include "check.hpp"
#include "system/zeroed_array.hpp"

using namespace ztf;

namespace {

constexpr std::size_t kPage = 4096, kPages = 2048;  // 8 MiB, as the arrays of a mirror

std::size_t resident_pages(const void* begin) {
  const auto address = (reinterpret_cast<std::uintptr_t>(begin) + kPage - 1) & ~(kPage - 1);
  std::vector<unsigned char> pages(kPages - 1);
  CHECK_EQ(::mincore(reinterpret_cast<void*>(address), (kPages - 1) * kPage, pages.data()), 0);
  std::size_t resident = 0;
  for (const unsigned char page : pages) resident += page & 1;
  return resident;
}

}  // namespace

TEST(an_array_in_the_place_of_a_used_one_takes_no_memory) {
  for (int round = 0; round < 4; ++round) {
    const ZeroedArray<char> used(kPages * kPage);
    for (std::size_t i = 0; i < kPages * kPage; i += kPage) used[i] = 1;
  }
  const ZeroedArray<char> array(kPages * kPage);
  CHECK(resident_pages(array.begin()) < 16);
  for (std::size_t i = 0; i < kPages * kPage; i += kPage / 2) CHECK_EQ(array[i], 0);
}

TEST(small_arrays_are_zeroed_and_aligned) {
  struct alignas(128) Record {
    char bytes[128];
  };
  for (int round = 0; round < 100; ++round) {
    const ZeroedArray<Record> array(100);
    CHECK_EQ(reinterpret_cast<std::uintptr_t>(array.begin()) % 128, 0u);
    for (int i = 0; i < 100; ++i) CHECK_EQ(array[i].bytes[127], 0);
    array[50].bytes[127] = 1;
  }
}
