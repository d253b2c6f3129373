"""The results folder: the only part of rkfbench that writes, and the one reader of what it wrote.

`files` writes whole files or none, `lock` keeps a folder to one run at a time, `blocks` holds finished blocks of runs,
`manifest` seals a folder with the hash of each of its files, `results` reads a sealed folder back.
"""

from rkfbench.store.results import Results

__all__ = ["Results"]
