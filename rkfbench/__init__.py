"""rkfbench: the experiments of five papers on robust Kalman filtering, and the claims that they support.

Importing the package is free; `rkfbench.filters`, `rkfbench.scenario`, `rkfbench.study` and the others are imported
where they are used.
"""

__version__ = "0.1.0"
