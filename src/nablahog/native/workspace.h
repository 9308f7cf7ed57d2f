// Memory that a thread uses again and again: new memory is slow at first.
#pragma once

#include <cstddef>
#include <memory>
#include <new>
#include <vector>

#ifdef __linux__
#include <sys/mman.h>
#endif

#include "vec.h"

namespace nablahog {

// Hands out arrays, each of whole cache lines and with room for a vector beyond its end.
class Workspace {
 public:
  // Takes back all arrays.  If they were in several pieces, they will be in one from now on.
  void clear() {
    if (pieces_.size() > 1) {
      pieces_.clear();
      if (least > 0) add_piece(total_);
    }
    used_ = total_ = 0;
  }

  template <class T>
  T* zeros(int64_t count) {
    T* array = uninitialized<T>(count);
    std::memset(static_cast<void*>(array), 0, round_up(count * sizeof(T) + vector_bytes, alignment));
    return array;
  }

  template <class T>
  T* uninitialized(int64_t count) {
    const size_t bytes = round_up(count * sizeof(T) + vector_bytes, alignment);
    if (pieces_.empty() || used_ + bytes > piece_size_) add_piece(bytes > least ? bytes : least);
    char* at = pieces_.back().get() + used_;
    used_ += bytes;
    total_ += bytes;
    return reinterpret_cast<T*>(at);
  }

 private:
  static constexpr size_t alignment = 64;
#if defined(__SANITIZE_ADDRESS__)
  static constexpr size_t least = 0;  // each array by itself, so that what is written beyond it is seen
#else
  static constexpr size_t least = 1 << 16;
#endif
  struct Free {
    void operator()(char* memory) const { ::operator delete(memory, std::align_val_t(alignment)); }
  };

  void add_piece(size_t bytes) {
    pieces_.emplace_back(static_cast<char*>(::operator new(bytes, std::align_val_t(alignment))));
    piece_size_ = bytes;
    used_ = 0;
#ifdef __linux__
    // As NumPy does for its arrays: pages of 2 MiB where there are such, so that fewer addresses are looked up.
    constexpr size_t page = 1 << 12, large = 1 << 22;
    char* memory = pieces_.back().get();
    const size_t skipped = -reinterpret_cast<uintptr_t>(memory) % page;
    if (bytes >= large) madvise(memory + skipped, bytes - skipped, MADV_HUGEPAGE);
#endif
  }

  std::vector<std::unique_ptr<char, Free>> pieces_;
  size_t piece_size_ = 0, used_ = 0, total_ = 0;
};

}  // namespace nablahog
