// Compiled core of palpate.inverse.constrained: the same numbers as the Python code beside it, without its overhead.
//
// It holds Newton's method of cone.py (newton.h) for a matrix or for few readings and a banded penalty (quadratic.h, band.h),
// and variances of sparse rows. BLAS and LAPACK are those of SciPy; the caller passes their functions.
// Arrays are in C order as in NumPy; the Fortran functions see them transposed. No state is shared between calls. An
// exception never leaves: a call that fails returns a code, and Python takes over.

#include "newton.h"

// A part of the free directions (factors.Part) and the factor of its penalty.
struct PartOfRows {
  Index start, size;
  double scale;
  const Index *first, *at;
  const double *entries, *inverse;
};

#ifdef _WIN32
#define EXPORTED extern "C" __declspec(dllexport)
#else
#define EXPORTED extern "C" __attribute__((visibility("default")))
#endif

// Whether the processor has the instructions of the second library, which is this code for AVX2 and FMA.
EXPORTED int second_library_runs() {
#if defined(__x86_64__) && defined(__GNUC__)
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
  return 0;
#endif
}

// Begin Newton's method for a `matrix`, or else for few readings. The arrays must live until `newton_free`.
EXPORTED Newton* newton_new(const Blas* blas, Index c, Index n, int free, int coupled, const Limits* limits, const double* linear, const double* start,
                            const double* matrix, Index readings, const double* columns, Index entries, const Index* row, const Index* col,
                            const double* values, const Index* rank) try {
  auto newton = std::make_unique<Newton>();
  newton->cone = {c, n, free != 0, coupled != 0};
  newton->limits = *limits, newton->linear = linear;
  if (matrix) {
    auto made = std::make_unique<Matrix>();
    made->matrix = matrix;
    newton->hessian = std::move(made);
  } else {
    auto made = std::make_unique<Few>();
    made->c = c, made->n = n, made->readings = readings, made->columns = columns, made->entries = entries;
    made->row = row, made->col = col, made->values = values;
    made->prepare(rank);
    newton->hessian = std::move(made);
  }
  newton->hessian->algebra = {blas}, newton->hessian->c = c, newton->hessian->n = n;
  newton->begin(start);
  return newton.release();
} catch (...) {
  return nullptr;
}

// One step: 0 to go on, 1 if it is done, 2 if Python must take over.
EXPORTED int newton_step(Newton* newton) try {
  return newton->step();
} catch (...) {
  return 2;
}

// The best point (component, cell) and its residual; returns the number of steps.
EXPORTED Index newton_best(const Newton* newton, double* x, double* size) {
  std::copy(newton->best.begin(), newton->best.end(), x);
  newton->cone.project(x);
  *size = newton->best_size;
  return newton->taken;
}

// Factorise on the face of the best point: 1 if it succeeds. `sizes` tells the arrays that `newton_factor` fills: whether
// it is `beside` and the factor's size, for a matrix; the numbers of parts and directions, and of each part start, index
// of the first part with the same chain, and the chain's size and number of entries, for few readings.
EXPORTED int newton_finish(Newton* newton, Index* sizes) try {
  if (!newton->finish()) return 0;
  if (auto* matrix = dynamic_cast<Matrix*>(newton->hessian.get())) {
    sizes[0] = matrix->beside, sizes[1] = matrix->size;
    return 1;
  }
  Index start = 0, *next = sizes + 2;
  const auto& parts = static_cast<Few*>(newton->hessian.get())->parts;
  for (const Part& part : parts) {
    const Index same = std::find_if(parts.begin(), parts.end(), [&](const Part& other) { return other.chain == part.chain; }) - parts.begin();
    for (Index value : {start, same, part.chain->size, part.chain->at.back()}) *next++ = value;
    start += part.chain->size;
  }
  sizes[0] = Index(parts.size()), sizes[1] = start;
  return 1;
} catch (...) {
  return 0;
}

// Copy the face, and the factor: of a matrix `lower` and, beside, `first`, `tied`, `some`; of few readings the lower factor
// of 1 + B'B, the blocks B of all parts together as `first`, the order of the directions as `some`, and for each part its
// scale and the arrays of its chain, if it is the first to have it.
EXPORTED void newton_factor(const Newton* newton, double* basis, double* values, double* lower, double* first, double* tied, Index* some,
                            double* scales, Index** panels, double** entries) {
  const auto copy = [](const auto& from, auto* to) { return std::copy(from.begin(), from.end(), to); };
  copy(newton->face.values, values);
  if (basis) copy(newton->face.basis, basis);
  if (auto* matrix = dynamic_cast<const Matrix*>(newton->hessian.get())) {
    copy(matrix->lower, lower);
    if (matrix->beside) copy(matrix->first, first), copy(matrix->tied, tied), copy(matrix->pressing, some);
    return;
  }
  const auto& few = *static_cast<const Few*>(newton->hessian.get());
  copy(few.lower, lower);
  for (std::size_t s = 0; s < few.parts.size(); ++s) {
    const Part& part = few.parts[s];
    some = copy(part.position, some), scales[s] = part.scale;
    for (Index a = 0; a < part.chain->size; ++a) first = std::copy_n(&part.block[a * few.lead()], few.readings, first);
    if (panels[s]) copy(part.chain->at, copy(part.chain->first, panels[s])), copy(part.chain->inverse, copy(part.chain->entries, entries[s]));
  }
}

EXPORTED void newton_free(Newton* newton) { delete newton; }

// L^-1 right or, back, L'^-1 right, in place, for `right` (size, many): 1 if it succeeds.
EXPORTED int band_solve(Index size, const Index* first, const Index* at, const double* entries, const double* inverse, int back, Index many,
                        double* right) try {
  if (!many) return 1;
  const Band band = {size, first, at, entries, inverse};
  Vector wide(fours(size) * fours(many));
  for (Index i = 0; i < size; ++i) std::copy_n(right + i * many, many, &wide[i * fours(many)]);
  if (back)
    band.backward(wide.data(), many);
  else
    band.forward(wide.data(), many);
  for (Index i = 0; i < size; ++i) std::copy_n(&wide[i * fours(many)], many, right + i * many);
  return 1;
} catch (...) {
  return 0;
}

// Variances of sparse rows (factors.FewReadings.variances): entries `row` (not decreasing), `col` and `value`, in the order
// of the parts; `seen` (direction, reading). With P = L L' the prior variance of a row r is that of L^-1 r'.
EXPORTED int row_variances(Index entries, const Index* row, const Index* col, const double* value, Index count, const PartOfRows* parts, Index readings,
                           const double* seen, double* out) try {
  constexpr Index together = 12;
  Vector told(readings), right;
  for (Index begin = 0, end; begin < entries; begin = end) {
    double found[together] = {};
    Index rows[together], many = 0;
    for (end = begin; end < entries; ++many) {  // up to twelve rows
      if (many == together) break;
      rows[many] = row[end];
      std::fill(told.begin(), told.end(), 0.0);
      for (; end < entries && row[end] == rows[many]; ++end) {
        const double* from = seen + col[end] * readings;
        for (Index r = 0; r < readings; ++r) told[r] += value[end] * from[r];
      }
      found[many] = -dot(told.data(), told.data(), readings);
    }
    for (const PartOfRows* part = parts; part < parts + count; ++part) {
      const Band band = {part->size, part->first, part->at, part->entries, part->inverse};
      const auto inside = [&](Index e) { return col[e] >= part->start && col[e] < part->start + part->size; };
      Index least = part->size;
      for (Index e = begin; e < end; ++e)
        if (inside(e)) least = std::min(least, col[e] - part->start);
      if (least == part->size) continue;
      right.assign(fours(part->size) * together, 0.0);
      for (Index e = begin, k = 0; e < end; ++e) {
        while (rows[k] != row[e]) ++k;
        if (inside(e)) right[(col[e] - part->start) * together + k] += value[e];
      }
      band.forward_some<together / 4>(right.data(), together, least / 4);
      double sums[together] = {};
      for (Index i = least; i < part->size; ++i)
        for (Index k = 0; k < together; ++k) sums[k] += right[i * together + k] * right[i * together + k];
      for (Index k = 0; k < together; ++k) found[k] += sums[k] / part->scale;
    }
    for (Index k = 0; k < many; ++k) out[rows[k]] = std::max(found[k], 0.0);
  }
  return 1;
} catch (...) {
  return 0;
}
