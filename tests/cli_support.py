"""What the tests of the command line share: depth files written by hand, and a way to run a command."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt
from typer.testing import CliRunner

from depthprint.cli.main import app

WIDTH, HEIGHT = 64, 48


def png_bytes(values: npt.NDArray[np.generic]) -> bytes:
    """A grey PNG written by hand, so that the reader under test has a writer of another origin."""
    depth = values.dtype.itemsize * 8
    rows = values.astype(values.dtype.newbyteorder(">"))
    raw = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", values.shape[1], values.shape[0], depth, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(raw))
        + chunk(b"IEND", b"")
    )


def depth_mm(seed: int) -> npt.NDArray[np.uint16]:
    """A room-like depth image: a sloping wall with boxes in front."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    depth = 2500 + 8.0 * u * rng.uniform(-1, 1) + 10.0 * v * rng.uniform(-1, 1)
    for _ in range(4):
        left, top = rng.integers(0, WIDTH - 16), rng.integers(0, HEIGHT - 16)
        depth[top : top + 16, left : left + 16] = rng.uniform(800, 1800)
    return depth.astype(np.uint16)


def write_recording(folder: Path, scenes: list[int]) -> Path:
    """A folder of one depth PNG per scene number; equal numbers show the same place."""
    folder.mkdir(parents=True)
    for number, scene in enumerate(scenes):
        (folder / f"{number:03d}.png").write_bytes(png_bytes(depth_mm(scene)))
    return folder


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr
