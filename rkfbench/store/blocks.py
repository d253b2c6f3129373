"""Finished blocks of runs, one file each: for every filter its numbers and the key of what they were computed from.

    sha256 of all that follows, in hex
    header, one line of JSON: for every filter the key, the names of its metrics and curves
    the arrays, as an uncompressed npz (read without pickle)

The key of a part is plain data; a part is reused when its key equals the wanted one (`study.plan` makes and compares
keys). Whatever does not read back exactly, by truncation or by a flipped bit, is `Damaged`.

A curve is kept by its moments, which merge over blocks, so files and memory stay small whatever the number of runs;
its median cannot be merged and is kept as that of the block. Beside them stands the path of one run, the first, as
papers like to show it.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rkfbench.store import files

FORMAT = 2
Array = NDArray[Any]
Key = Mapping[str, Any]


class Damaged(Exception):
    """A block file that does not hold what was written."""


class Curve(NamedTuple):
    """Moments over the runs that did not fail and are defined, at the steps k; `m2` is the sum of squared deviations.
    All (K,).
    """

    k: Array
    n: Array  # the number of those runs
    mean: Array
    m2: Array
    median: Array  # failed runs count as +inf
    first: Array  # the path of the first run; NaN where it failed

    @classmethod
    def of(cls, k: Array, paths: Array, failed: Array) -> Curve:
        """The moments of `paths` (K, M) over the runs that are not `failed` (M,); NaN is a step at which the metric of
        a run is not defined.
        """
        good = paths[:, ~failed]
        there = ~np.isnan(good)
        count = there.sum(1).astype(float)
        with np.errstate(invalid="ignore"):
            mean = np.where(there, good, 0.0).sum(1) / count
            m2 = np.where(there, (good - mean[:, None]) ** 2, 0.0).sum(1)
        return cls(np.asarray(k, float), count, mean, m2, _middle(np.where(failed, np.inf, paths)), paths[:, 0])

    def merge(self, other: Curve) -> Curve:
        """The moments over both sets of runs; median and path stay those of the first."""
        count = self.n + other.n
        with np.errstate(invalid="ignore"):
            delta = other.mean - self.mean
            mean = self.mean + delta * (other.n / count)
            m2 = self.m2 + other.m2 + delta**2 * (self.n * other.n / count)
        mean, m2 = (
            np.where(other.n == 0, mine, np.where(self.n == 0, theirs, both))
            for mine, theirs, both in ((self.mean, other.mean, mean), (self.m2, other.m2, m2))
        )
        return Curve(self.k, count, mean, m2, self.median, self.first)


def _middle(paths: Array) -> Array:
    """The median of each row of (K, M), NaN left out: by a sort of all rows, of which np.median takes six times the
    time.
    """
    ordered = np.sort(paths, axis=1)  # NaN last
    defined = paths.shape[1] - np.isnan(ordered).sum(1)
    low, high = (np.take_along_axis(ordered, at[:, None], 1)[:, 0] for at in ((defined - 1) // 2, defined // 2))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(low == high, low, (low + high) / 2)


@dataclass(frozen=True)
class Part:
    """What one filter gave in one block of M runs."""

    failed: Array  # (M,) bool
    lost: Array  # (M,) bool
    values: Mapping[str, Array]  # metric -> (M,)
    curves: Mapping[str, Curve]  # metric -> moments over the block
    death: str = ""  # how the first of the failed runs died, where that is known


def write(path: Path, parts: Mapping[str, tuple[Key, Part]]) -> None:
    """Write the parts (by label of the filter) of one block."""
    header: dict[str, Any] = {"format": FORMAT, "parts": {}}
    arrays: dict[str, Array] = {}
    for index, (label, (key, part)) in enumerate(parts.items()):
        header["parts"][label] = {"key": key, "values": list(part.values), "curves": list(part.curves)}
        if part.death:
            header["parts"][label]["death"] = part.death
        arrays[f"{index}.runs"] = np.array([part.failed, part.lost])
        arrays[f"{index}.values"] = np.array([*part.values.values()])
        for number, curve in enumerate(part.curves.values()):
            arrays[f"{index}.curve{number}"] = np.array(curve)
    payload = io.BytesIO()
    payload.write(json.dumps(header).encode() + b"\n")
    np.savez(payload, **arrays)  # type: ignore[arg-type]
    body = payload.getvalue()
    files.write(path, hashlib.sha256(body).hexdigest().encode() + b"\n" + body)


def keys(path: Path) -> dict[str, Key]:
    """The key of each part of a block file; {} when there is no file; Damaged when it does not read back."""
    if not path.exists():
        return {}
    header, _ = _open(path)
    return {label: part["key"] for label, part in header["parts"].items()}


def digest(path: Path) -> str:
    """The hash of all that a block file holds, as it says itself; "" when there is no file."""
    try:
        with path.open("rb") as file:
            return file.readline().decode(errors="replace").strip()
    except FileNotFoundError:
        return ""


def read(path: Path, labels: set[str] | None = None) -> dict[str, Part]:
    """The parts of a block file, all or those of some labels; Damaged when it does not read back."""
    header, payload = _open(path)
    arrays = np.load(io.BytesIO(payload), allow_pickle=False)
    return {
        label: _part(arrays, index, part)
        for index, (label, part) in enumerate(header["parts"].items())
        if labels is None or label in labels
    }


def _part(arrays: Mapping[str, Array], index: int, names: Mapping[str, Any]) -> Part:
    failed, lost = arrays[f"{index}.runs"]
    curves = {name: Curve(*arrays[f"{index}.curve{number}"]) for number, name in enumerate(names["curves"])}
    values = dict(zip(names["values"], arrays[f"{index}.values"], strict=True))
    return Part(failed, lost, values, curves, names.get("death", ""))


def _open(path: Path) -> tuple[dict[str, Any], bytes]:
    try:
        digest, body = path.read_bytes().split(b"\n", 1)
        if hashlib.sha256(body).hexdigest().encode() != digest:
            raise ValueError
        line, payload = body.split(b"\n", 1)
        header = json.loads(line)
    except (OSError, ValueError) as error:
        raise Damaged(f"{path} is damaged") from error
    if header.get("format") != FORMAT:
        raise Damaged(f"{path} was written by another version of rkfbench")
    return header, payload
