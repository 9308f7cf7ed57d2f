// The interface of the operator's loops.  Pointers to T are double* for double pixels, else float*.
#include "forward.h"
#include "interface.h"
#include "jvp.h"
#include "vjp.h"

namespace {

using nablahog::Images;
using nablahog::Normalizer;
using nablahog::Range;

bool is_double(const nablahog_tables& tables) { return tables.pixels == NABLAHOG_FLOAT64; }

Images images_at(const void* pixels, const int64_t* strides) {
  return {pixels, {strides[0], strides[1], strides[2], strides[3]}};
}

// Calls body.template operator()<T, Rule>() with the tables's number type and rule of votes.
template <class Body>
void with_types(const nablahog_tables& tables, Body body) {
  nablahog::with_real(is_double(tables), [&]<class T>() {
    switch (tables.votes) {
      case NABLAHOG_LINEAR:
        return body.template operator()<T, nablahog::Linear<T>>();
      case NABLAHOG_OPENCV:
        return body.template operator()<T, nablahog::OpenCV<T>>();
      case NABLAHOG_VLFEAT:
        return body.template operator()<T, nablahog::VLFeat<T>>();
      case NABLAHOG_NEAREST:
        return body.template operator()<T, nablahog::Nearest<T>>();
      default:
        return body.template operator()<T, nablahog::Begun<T>>();
    }
  });
}

// Calls body(normaliser, where an image's cells and its descriptor begin, memory for one) for images in a range.
template <class Body>
int each_descriptor(const nablahog_tables& tables, Range range, Body body) {
  return nablahog::guarded([&] {
    nablahog::with_real(is_double(tables), [&]<class T>() {
      thread_local nablahog::Workspace work;
      work.clear();
      const auto norm = nablahog::make_normalizer<T>(tables, work);
      T* values = work.zeros<T>(nablahog::out_size(tables));
      for (int64_t image = range.first; image < range.last; ++image) {
        body(*norm, image * nablahog::cells_size(tables), image * nablahog::out_size(tables), values);
      }
    });
  });
}

}  // namespace

// Cells (images, rows, cols, bins) and descriptors of images first … last - 1; one of them may be null.
NABLAHOG_API int nablahog_hog(const nablahog_tables* tables, const void* pixels, const int64_t* strides, int64_t first,
                              int64_t last, void* cells, void* out) {
  return nablahog::guarded([&] {
    with_types(*tables, [&]<class T, class Rule>() {
      nablahog::forward<T, Rule>(*tables, images_at(pixels, strides), Range{first, last}, static_cast<T*>(cells),
                                 static_cast<T*>(out));
    });
  });
}

// Bands of one image.  Sets `broken`, of the first band, to 1 where a pixel is not finite.
NABLAHOG_API int nablahog_hog_bands(const nablahog_tables* tables, const void* pixels, const int64_t* strides,
                                    int64_t first, int64_t last, void* band_cells, uint8_t* broken) {
  return nablahog::guarded([&] {
    with_types(*tables, [&]<class T, class Rule>() {
      broken[first] = nablahog::forward_bands<T, Rule>(*tables, images_at(pixels, strides), Range{first, last},
                                                       static_cast<T*>(band_cells));
    });
  });
}

// Numbers of the cells of a band
NABLAHOG_API int nablahog_band_size(const nablahog_tables* tables, int64_t* size) {
  nablahog::with_real(is_double(*tables), [&]<class T>() { *size = nablahog::Pooling<T>::band_size(*tables); });
  return 0;
}

NABLAHOG_API int nablahog_join_bands(const nablahog_tables* tables, const void* band_cells, void* cells) {
  return nablahog::guarded([&] {
    nablahog::with_real(is_double(*tables), [&]<class T>() {
      nablahog::join_bands(*tables, static_cast<const T*>(band_cells), static_cast<T*>(cells));
    });
  });
}

// Gradients of images from those of descriptors or, if `cells` is null, of cells
NABLAHOG_API int nablahog_hog_vjp(const nablahog_tables* tables, const void* pixels, const int64_t* strides,
                                  int64_t first, int64_t last, const void* cells, const void* grad, void* grad_images) {
  return nablahog::guarded([&] {
    with_types(*tables, [&]<class T, class Rule>() {
      nablahog::vjp<T, Rule>(*tables, images_at(pixels, strides), Range{first, last}, static_cast<const T*>(cells),
                             static_cast<const T*>(grad), static_cast<T*>(grad_images));
    });
  });
}

// Rows of the gradient of one image from that of its cells.  Sets `broken`, of the first row, to 1 where a pixel is not
// finite.
NABLAHOG_API int nablahog_hog_vjp_rows(const nablahog_tables* tables, const void* pixels, const int64_t* strides,
                                       int64_t first, int64_t last, const void* grad_cells, void* grad_image,
                                       uint8_t* broken) {
  return nablahog::guarded([&] {
    with_types(*tables, [&]<class T, class Rule>() {
      broken[first] = nablahog::vjp_rows<T, Rule>(*tables, images_at(pixels, strides), Range{first, last},
                                                  static_cast<const T*>(grad_cells), static_cast<T*>(grad_image));
    });
  });
}

// Tangents of descriptors or, if `cells` is null, of cells, from those of images
NABLAHOG_API int nablahog_hog_jvp(const nablahog_tables* tables, const void* pixels, const int64_t* strides,
                                  int64_t first, int64_t last, const void* tangents, const void* cells, void* out) {
  return nablahog::guarded([&] {
    with_types(*tables, [&]<class T, class Rule>() {
      nablahog::jvp<T, Rule>(*tables, images_at(pixels, strides), Range{first, last}, static_cast<const T*>(tangents),
                             static_cast<const T*>(cells), static_cast<T*>(out));
    });
  });
}

// Whether there are loops of a kind of normaliser
NABLAHOG_API int nablahog_has_normalizer(const char* kind, int32_t* found) {
  *found = nablahog::normalizer_maker<float>(kind) != nullptr;
  return 0;
}

// The normaliser: cells (images, rows, cols, bins) to descriptors, its vjp and its jvp
NABLAHOG_API int nablahog_normalize(const nablahog_tables* tables, int64_t first, int64_t last, const void* cells,
                                    void* out) {
  return each_descriptor(*tables, {first, last}, [&]<class T>(Normalizer<T>& norm, int64_t cell, int64_t at, T*) {
    norm.forward(static_cast<const T*>(cells) + cell, static_cast<T*>(out) + at);
  });
}

NABLAHOG_API int nablahog_normalize_vjp(const nablahog_tables* tables, int64_t first, int64_t last, const void* cells,
                                        const void* grad_out, void* grad_cells) {
  return each_descriptor(*tables, {first, last}, [&]<class T>(Normalizer<T>& norm, int64_t cell, int64_t at, T*) {
    norm.vjp(static_cast<const T*>(cells) + cell, static_cast<const T*>(grad_out) + at,
             static_cast<T*>(grad_cells) + cell);
  });
}

NABLAHOG_API int nablahog_normalize_jvp(const nablahog_tables* tables, int64_t first, int64_t last, const void* cells,
                                        const void* tangents, void* out) {
  return each_descriptor(*tables, {first, last},
                         [&]<class T>(Normalizer<T>& norm, int64_t cell, int64_t at, T* values) {
                           norm.jvp({static_cast<const T*>(cells) + cell, static_cast<const T*>(tangents) + cell},
                                    {values, static_cast<T*>(out) + at});
                         });
}

// Adds the sum of squares as the global normaliser has it, for images that are read in strips.
NABLAHOG_API int nablahog_long_energy(int32_t double_precision, const void* x, int64_t count, double* total) {
  nablahog::with_real(double_precision, [&]<class T>() {
    *total = nablahog::long_dot(static_cast<const T*>(x), static_cast<const T*>(x), count, *total);
  });
  return 0;
}
