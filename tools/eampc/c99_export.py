"""A law as self-contained C99: law.h, law.c, a test that carries its points, a Makefile.

No heap, no libm, static const tables. Every sum is in the order of the daemon's evaluator
(daemon/control/point_location.hpp), so that in double both give the same bits when the compiler
does not fuse multiplications with additions (-ffp-contract=off) and computes double in double.

With `single=True` the arithmetic is float, with an error that is bounded beforehand:

  - sides: a hyperplane is compared in float; where the margin is within `guard` the comparison is
    made again in double, so the leaf is always that of the double law. With ε = 2^-24, D levels of
    pairwise sums and |p_j| ≤ P_j, a margin in float is wrong by at most
    (D + 4) ε (Σ|n_j| P_j + |offset|): one ε for each stored number, product, level and difference.
  - value: a piece in float is wrong by at most (D + 3) ε (Σ|g_j| P_j + |offset|); max and min of
    values are wrong by no more than the worst of them, and the same holds for the clip. The ends of
    the box and of the control's range rounded to float add their own difference.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eampc.errors import UserError
from eampc.law import Law

_EPSILON = 2.0**-24
_LARGEST_FLOAT = float(np.finfo(np.float32).max)
# What second-order terms, the double law's own rounding and numbers below 1e-38 add to a bound.
_SLACK = 1.002
_TEST_POINTS = 500
_PARENTHESES = "({} + {})"


class ExportedFile(NamedTuple):
    name: str
    text: str


def export_c99(law: Law, folder: str | Path, single: bool = False) -> list[Path]:
    """Write the files into `folder`, which is made if it is not there; return their paths."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths = []
        for file in c99_files(law, single):
            path = folder / file.name
            path.write_text(file.text, encoding="utf-8")
            paths.append(path)
    except OSError as error:
        raise UserError(
            f"{folder}: cannot be written ({error.strerror}); name another folder"
        ) from None
    return paths


def c99_files(law: Law, single: bool = False) -> list[ExportedFile]:
    """The files of the export; the same law gives the same text."""
    source = _Source(law, single)
    return [
        ExportedFile("law.h", source.header()),
        ExportedFile("law.c", source.code()),
        ExportedFile("law_test.c", source.test()),
        ExportedFile("Makefile", _MAKEFILE),
    ]


def single_precision_error(law: Law) -> float:
    """Largest difference between the float export and the double law, in units of u."""
    section = law.payload["law"]
    reach = np.maximum(np.abs(law.lower), np.abs(law.upper))
    gain, offset = law.pieces
    sums = math.ceil(math.log2(gain.shape[1] + 1))
    value = (sums + 3) * _EPSILON * (np.abs(gain) @ reach + np.abs(offset)).max()
    inner_lower, inner_upper = _box_in_float(law)
    moved = np.maximum(inner_lower - law.lower, law.upper - inner_upper)
    box = (np.abs(gain) @ moved).max()
    range_ = _EPSILON * max(abs(section["u_min"]), abs(section["u_max"]))
    return float(f"{_SLACK * (value + box + range_):.3e}")


def _guard(law: Law) -> float:
    """Margin of a hyperplane in float below which double decides."""
    planes = law.payload["law"]["evaluator"]["hyperplanes"]
    if len(planes) == 0:
        return 0.0
    reach = np.maximum(np.abs(law.lower), np.abs(law.upper))
    sums = math.ceil(math.log2(max(len(reach), 2)))
    largest = (np.abs(planes[:, :-1]) @ reach + np.abs(planes[:, -1])).max()
    return float(_SLACK * (sums + 4) * _EPSILON * largest)


def _box_in_float(law: Law) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The largest box of float corners inside the parameter box, as double."""
    lower, upper = law.lower.astype(np.float32), law.upper.astype(np.float32)
    lower = np.where(lower < law.lower, np.nextafter(lower, np.float32(np.inf)), lower)
    upper = np.where(upper > law.upper, np.nextafter(upper, np.float32(-np.inf)), upper)
    return lower.astype(np.float64), upper.astype(np.float64)


def _pairwise(terms: Sequence[str]) -> str:
    """Sum of the terms in adjacent pairs, level by level, an odd one carried."""
    while len(terms) > 1:
        pairs = [_PARENTHESES.format(*terms[i : i + 2]) for i in range(0, len(terms) - 1, 2)]
        terms = [*pairs, *terms[len(terms) - len(terms) % 2 :]]
    return terms[0]


def _rows(items: Iterable[str], indent: str = "  ") -> str:
    """Comma-separated items in lines of at most 100 characters."""
    lines, line = [], indent
    for item in items:
        if len(line) + len(item) + 2 > 100:
            lines.append(line.rstrip())
            line = indent
        line += f"{item}, "
    lines.append(line.rstrip())
    return "\n".join(lines)


class _Source:
    def __init__(self, law: Law, single: bool) -> None:
        self._law = law
        self._single = single
        self._real = "float" if single else "double"
        self._section = law.payload["law"]
        self._evaluator = self._section["evaluator"]
        self._parameters = len(law.lower)
        self._folds = bool(np.any(self._evaluator["fold"] != 0.0))

    # Numbers and tables

    def _number(self, value: float, double: bool = False) -> str:
        if self._single and not double:
            if abs(value) > _LARGEST_FLOAT:
                raise UserError(
                    f"the law holds the number {value:.3g}, too large for float; export double"
                )
            return _hex(float(np.float32(value))) + "f"
        return _hex(float(value))

    def _reals(self, name: str, values: NDArray[np.float64], double: bool = False) -> str:
        kind = "double" if double else self._real
        numbers = (self._number(value, double) for value in values.ravel())
        columns = "" if values.ndim == 1 else f"[{values.shape[1]}]"
        if values.ndim == 1:
            return f"static const {kind} {name}[{len(values)}] = {{\n{_rows(numbers)}\n}};\n"
        rows = "\n".join(
            "  {" + _rows((self._number(value, double) for value in row), "   ").strip() + "},"
            for row in values
        )
        return f"static const {kind} {name}[{len(values)}]{columns} = {{\n{rows}\n}};\n"

    @staticmethod
    def _integers(name: str, values: NDArray[np.int32], shape: str | None = None) -> str:
        small = values.size == 0 or (values.min() >= -(2**15) and values.max() < 2**15)
        kind = "int16_t" if small else "int32_t"
        if values.ndim == 1:
            body = _rows(str(value) for value in values)
        else:
            body = "\n".join("  {" + ", ".join(map(str, row)) + "}," for row in values)
        size = shape or "".join(f"[{n}]" for n in values.shape)
        return f"static const {kind} {name}{size} = {{\n{body}\n}};\n"

    @staticmethod
    def _masks(name: str, halves: NDArray[np.int32]) -> str:
        words = [int(np.uint32(low)) | int(np.uint32(high)) << 32 for low, high in halves]
        body = _rows(f"UINT64_C({word:#x})" for word in words)
        return f"static const uint64_t {name}[{len(words)}] = {{\n{body}\n}};\n"

    def _dot(self, row: str, point: str = "p", cast: str = "") -> str:
        return _pairwise([f"{row}[{j}] * {cast}{point}[{j}]" for j in range(self._parameters)])

    # Files

    def header(self) -> str:
        rig, law = self._law.payload["rig"], self._law
        error = f"#define LAW_ERROR {single_precision_error(law):.3e}\n" if self._single else ""
        meaning = (
            "/* In float; within LAW_ERROR of the double law at the same p. */"
            if self._single
            else "/* In double; the daemon's bits, if compiled with -ffp-contract=off. */"
        )
        parameters = "\n".join(
            f" *   p[{j}] {name} ({unit}), {low:g} .. {high:g}"
            for j, (name, unit, low, high) in enumerate(
                zip(law.parameter_names, law.parameter_units, law.lower, law.upper, strict=True)
            )
        )
        low, high = law.control_range
        return f"""/* Explicit control law of the rig {_plain(rig["name"])}
 * made by eampc {rig["eampc_version"]} from inputs {rig["inputs_sha256"]}
 *
 * C99, no heap, no libm. Compile with: cc -std=c99 -O2 -ffp-contract=off -c law.c
 *
{parameters}
 * p is clamped onto that box. The result is the control u in {low:g} .. {high:g};
 * NaN in p gives NaN.
 */
#ifndef LAW_H
#define LAW_H

#define LAW_PARAMETERS {self._parameters}
/* Most multiplications, additions and comparisons of one call, clamping left out. */
#define LAW_WORST_OPERATIONS {self._worst_operations()}
{error}
{meaning}
{self._real} law_control(const {self._real} p[LAW_PARAMETERS]);

#endif
"""

    def _worst_operations(self) -> int:
        e = self._evaluator
        sides = len(e["hyperplanes"]) if e["kind"] == "flat" else 3 * e["depth"]
        # In float every side may have to be decided again, in double.
        again = sides * (2 * self._parameters + 3) if self._single else 0
        return e["worst_operations"] + again

    def code(self) -> str:
        return "\n".join(
            part
            for part in (
                "/* See law.h. Tables, then the evaluation: sides of hyperplanes lead to a leaf,\n"
                " * whose value is the max over its terms of the min over a term's pieces. */",
                '#include "law.h"\n\n#include <stdint.h>\n',
                self._tables(),
                self._sides() if len(self._evaluator["hyperplanes"]) else "",
                self._pieces(),
                self._flat_leaf() if self._evaluator["kind"] == "flat" else self._tree_leaf(),
                self._control(),
            )
            if part
        )

    def _tables(self) -> str:
        e, section = self._evaluator, self._section
        lower, upper = (
            _box_in_float(self._law) if self._single else (self._law.lower, self._law.upper)
        )
        pieces = np.column_stack([section["piece_offset"], section["piece_gain"]])
        parts = [self._reals("lower", lower), self._reals("upper", upper)]
        if len(e["hyperplanes"]):
            parts.append(self._reals("planes", e["hyperplanes"]))
            if self._single:
                parts.append(self._reals("exact_planes", e["hyperplanes"], double=True))
        if e["kind"] == "flat":
            parts += [
                self._masks("leaf_care", e["leaf_care"]),
                self._masks("leaf_bits", e["leaf_bits"]),
            ]
        elif len(e["node_planes"]):
            parts.append(self._integers("node_planes", e["node_planes"]))
            parts.append(self._integers("node_children", e["node_children"]))
        for name in ("leaf_first", "term_first", "term_pieces"):
            parts.append(self._integers(name, e[name]))
        parts.append("/* offset, gains */\n" + self._reals("pieces", pieces))
        if self._folds:
            parts.append(self._reals("fold", e["fold"], double=True))
        return "\n".join(parts)

    def _sides(self) -> str:
        offset = self._parameters
        if not self._single:
            return f"""static int is_above(int plane, const double *p) {{
  const double *n = planes[plane];
  return !({self._dot("n")} <= n[{offset}]);
}}
"""
        return f"""/* Float decides unless rounding could; then double. */
static int is_above(int plane, const float *p) {{
  const float *n = planes[plane];
  const double *e = exact_planes[plane];
  const float guard = {self._number(_guard(self._law) * (1 + 2.0**-23))};
  const float margin = {self._dot("n")} - n[{offset}];
  if (margin > guard) return 1;
  if (margin < -guard) return 0;
  return !({self._dot("e", cast="(double)")} <= e[{offset}]);
}}
"""

    def _pieces(self) -> str:
        real = self._real
        terms = ["g[0]", *(f"g[{j + 1}] * p[{j}]" for j in range(self._parameters))]
        return f"""static {real} piece_value(int piece, const {real} *p) {{
  const {real} *g = pieces[piece];
  return {_pairwise(terms)};
}}

static {real} leaf_value(int leaf, const {real} *p) {{
  {real} largest = 0;
  int term;
  for (term = leaf_first[leaf]; term < leaf_first[leaf + 1]; ++term) {{
    int i = term_first[term];
    {real} smallest = piece_value(term_pieces[i], p);
    for (++i; i < term_first[term + 1]; ++i) {{
      const {real} value = piece_value(term_pieces[i], p);
      if (value < smallest) smallest = value;
    }}
    if (term == leaf_first[leaf] || smallest > largest) largest = smallest;
  }}
  return largest;
}}
"""

    def _tree_leaf(self) -> str:
        e, real = self._evaluator, self._real
        if not len(e["node_planes"]):
            return f"""static int leaf_of(const {real} *p) {{
  (void)p;
  return {~e["root"]};
}}
"""
        return f"""static int leaf_of(const {real} *p) {{
  int code = {e["root"]};
  int depth;
  for (depth = 0; code >= 0 && depth < {e["depth"]}; ++depth) {{
    int place = 0, path = 0, level;
    for (level = 0; level < 3; ++level) {{
      const int plane = node_planes[code][place];
      const int above = plane >= 0 && is_above(plane, p);
      place = 2 * place + 1 + above;
      path = 2 * path + above;
    }}
    code = node_children[code][path];
  }}
  return -1 - code;
}}
"""

    def _flat_leaf(self) -> str:
        e = self._evaluator
        return f"""static int leaf_of(const {self._real} *p) {{
  uint64_t above = 0;
  int i;
  for (i = 0; i < {len(e["hyperplanes"])}; ++i) above |= (uint64_t)is_above(i, p) << i;
  for (i = 0; i < {len(e["leaf_care"])}; ++i) {{
    if ((above & leaf_care[i]) == leaf_bits[i]) return i;
  }}
  return -1;
}}
"""

    def _control(self) -> str:
        real, n = self._real, self._parameters
        low, high = (self._number(u) for u in self._law.control_range)
        fold = ""
        if self._folds:
            fold = f"""  if ({self._dot("fold", "at", "(double)" if self._single else "")} < 0) {{
    sign = -1;
    for (j = 0; j < {n}; ++j) at[j] = -at[j];
  }}
"""
        return f"""{real} law_control(const {real} p[LAW_PARAMETERS]) {{
  {real} at[{n}];
  {real} sign = 1;
  {real} u;
  int leaf, j;
  for (j = 0; j < {n}; ++j) {{
    if (p[j] != p[j]) return p[j];
    at[j] = p[j] < lower[j] ? lower[j] : upper[j] < p[j] ? upper[j] : p[j];
  }}
{fold}  leaf = leaf_of(at);
  if (leaf < 0) return (at[0] - at[0]) / (at[0] - at[0]); /* NaN */
  u = sign * leaf_value(leaf, at);
  if (u - u != 0) return u; /* not finite */
  return u < {low} ? {low} : {high} < u ? {high} : u;
}}
"""

    def test(self) -> str:
        points = _test_points(self._law)
        if self._single:
            points = points.astype(np.float32).astype(np.float64)
        values = self._law.evaluate(points)
        if self._single:
            wrong = "!(fabs_((double)law_control(points[i]) - expected[i]) <= LAW_ERROR)"
            helper = "static double fabs_(double x) { return x < 0 ? -x : x; }\n\n"
        else:
            wrong, helper = "law_control(points[i]) != expected[i]", ""
        return f"""/* Holds the law against values of the daemon's evaluator.
 * Exit status 0: all as expected; 1: a line for each that is not. */
#include <stdio.h>

#include "law.h"

{self._reals("points", points)}
{self._reals("expected", values, double=True)}
{helper}int main(void) {{
  int wrong = 0, i;
  for (i = 0; i < {len(points)}; ++i) {{
    if ({wrong}) {{
      printf("point %d: %a, expected %a\\n", i, (double)law_control(points[i]), expected[i]);
      ++wrong;
    }}
  }}
  printf("%d of {len(points)} points differ\\n", wrong);
  return wrong != 0;
}}
"""


def _hex(value: float) -> str:
    """A C99 hexadecimal constant without trailing zeros."""
    return re.sub(r"\.?0+p", "p", value.hex())


def _plain(text: str) -> str:
    """Text that cannot end a comment."""
    return text.replace("*/", "* /")


def _test_points(law: Law) -> NDArray[np.float64]:
    """Points of the box, some beyond it and some on hyperplanes, the same for the same law."""
    random = np.random.default_rng(1)
    lower, upper = law.lower, law.upper
    points = random.uniform(lower, upper, size=(_TEST_POINTS, len(lower)))
    tenth = _TEST_POINTS // 10
    points[:tenth] = lower + (upper - lower) * random.uniform(-0.3, 1.3, (tenth, len(lower)))
    planes = law.payload["law"]["evaluator"]["hyperplanes"]
    for point in points[tenth : 5 * tenth] if len(planes) else ():
        plane = planes[random.integers(len(planes))]
        normal = plane[:-1]
        point -= normal * (normal @ point - plane[-1]) / max(normal @ normal, 1e-300)
    return points


_MAKEFILE = """# make check: builds the law's own test and runs it.
CFLAGS ?= -O2
LAW_CFLAGS = -std=c99 -pedantic -Wall -Werror -ffp-contract=off

check: law_test
\t./law_test

law_test: law_test.c law.c law.h
\t$(CC) $(CFLAGS) $(LAW_CFLAGS) -o $@ law_test.c law.c

clean:
\trm -f law_test

.PHONY: check clean
"""
