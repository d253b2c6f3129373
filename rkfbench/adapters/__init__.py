"""Filters of other libraries, to be named in a scenario: `{use: rkfbench.adapters.filterpy:ekf}`. Extra: `peers`."""
