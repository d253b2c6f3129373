"""How fast the filters are beside those of other libraries and a plain C kernel, on the same problems.

Problems, implementations, measuring and reporting are apart: `problems`, `peers`, `measure`, `report`. No other part
of the package uses this one.
"""
