"""From the part of Python that numba compiles here, specialised on fixed shapes, to C99.

A function that can be translated
- takes float64 or int64 arrays of known shape, rows of them (`a[i]`), and numbers; returns nothing,
  a number or a tuple of numbers;
- holds assignments (also of tuples, and augmented), `if`, `while`, `for … in range(…)`, `break`,
  `continue`, `return`, conditional expressions and docstrings;
- reads and writes arrays element by element, fills one (`a[:] = 0.0`, `a[i, :] = b[i]`), and makes
  new ones by `np.zeros` or `np.empty` of a shape that is known;
- uses + - * / // % **, comparisons, and, or, not, abs, min, max, len, int, float, `a.shape`,
  `a.size`, math.* and np.* of numbers, numbers of its module and arrays of them that never change,
  and functions like itself, compiled by numba or not.
Numbers that are known when it is translated (shapes, counts) are folded in, and branches that they
rule out are left out.
"""
