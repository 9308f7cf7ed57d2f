// Numbers the fields of the struct that Python fills in, in the order of plan.h: a test reads them in its own order.
#include <type_traits>

#include "interface.h"
#include "plan.h"

namespace {

int64_t next = 0;

template <class Field>
void number(Field& field) {
  ++next;
  if constexpr (std::is_pointer_v<Field>) {
    field = reinterpret_cast<Field>(static_cast<uintptr_t>(next));
  } else {
    field = static_cast<Field>(next);
  }
}

template <class... Fields>
void number_all(Fields&... fields) {
  (number(fields), ...);
}

void number_axis(nablahog_axis& a) {
  number_all(a.pixels, a.cells, a.extent, a.stretches, a.longest, a.run, a.stretch, a.weights, a.run_weights,
             a.cell_weights);
}

}  // namespace

NABLAHOG_API int nablahog_number_fields(nablahog_plan* p) {
  next = 0;
  number_all(p->channels, p->height, p->width, p->pixels, p->averaged, p->square_root, p->sobel, p->border,
             p->border_doubled, p->scale, p->black, p->border_value, p->channel_weights, p->last_wins, p->votes,
             p->bins, p->is_signed, p->bin_before, p->tiny, p->up, p->bins_per_half_turn, p->bin_offset, p->slope,
             p->directions_count, p->directions, p->arctangent, p->arccosine_least, p->arccosine_unit);
  number_axis(p->rows);
  number_axis(p->cols);
  number_all(p->normalizer, p->out_rows, p->out_cols, p->out_channels, p->constants);
  return 0;
}
