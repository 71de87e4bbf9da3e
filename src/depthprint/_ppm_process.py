"""PPM lengths from a process that is replaced now and then: pyppmd keeps about 18 kB of every stream it made.

``python -m depthprint._ppm_process`` is that process.
"""

from __future__ import annotations

import contextlib
import os
import struct
import subprocess
import sys
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from depthprint.errors import DepthprintError

__all__ = ["PpmProcess", "ppm_length"]

ORDER = 6
_MEMORY = 16 << 20
_SMALL_DATA, _SMALL_MEMORY = 16 << 10, 1 << 20
_STREAMS_A_PROCESS = 10_000
_WORD = struct.Struct("<I")


def ppm_length(data: bytes) -> int:
    """Bytes of ``data`` under PPMd var. H of order 6, without an end mark; 0 for none."""
    import pyppmd

    if not data:
        return 0
    stream = pyppmd.Ppmd7Encoder(ORDER, _SMALL_MEMORY if len(data) <= _SMALL_DATA else _MEMORY)
    return len(stream.encode(data)) + len(stream.flush(endmark=False))


class PpmProcess:
    """A child process that compresses; not for two threads at once. Raises DepthprintError when the child dies."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None
        self._left = 0

    def lengths(self, streams: Sequence[bytes]) -> list[int]:
        """Compressed length of each stream, in order."""
        lengths: list[int] = []
        while len(lengths) < len(streams):
            if self._left == 0:
                self._replace()
            part = streams[len(lengths) : len(lengths) + self._left]
            lengths.extend(self._ask(part))
            self._left -= len(part)
        return lengths

    def _ask(self, streams: Sequence[bytes]) -> list[int]:
        child = self._child
        assert child is not None
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            child.stdin.write(_WORD.pack(len(streams)))
            for data in streams:
                child.stdin.write(_WORD.pack(len(data)) + data)
            child.stdin.flush()
            answer = child.stdout.read(_WORD.size * len(streams))
        except BrokenPipeError:
            answer = b""
        if len(answer) != _WORD.size * len(streams):
            raise DepthprintError(f"compressor ppm: its process ended early, with status {child.wait()}")
        return [word for (word,) in _WORD.iter_unpack(answer)]

    def _replace(self) -> None:
        if self._child is not None:
            _stop(self._child)
        package_root = str(Path(__file__).parent.parent)
        paths = [package_root, *filter(None, [os.environ.get("PYTHONPATH")])]
        self._child = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        )
        weakref.finalize(self, _stop, self._child)
        self._left = _STREAMS_A_PROCESS


def _stop(child: subprocess.Popen[bytes]) -> None:
    for pipe in (child.stdin, child.stdout):
        # a dead child's pipe still holds what was not sent; `_ask` has reported that
        with contextlib.suppress(BrokenPipeError):
            if pipe is not None:
                pipe.close()
    child.wait()


def _serve(source: BinaryIO, sink: BinaryIO) -> None:
    while head := source.read(_WORD.size):
        streams = []
        for _ in range(_WORD.unpack(head)[0]):
            (size,) = _WORD.unpack(source.read(_WORD.size))
            streams.append(source.read(size))
        sink.write(b"".join(_WORD.pack(ppm_length(data)) for data in streams))
        sink.flush()


if __name__ == "__main__":
    _serve(sys.stdin.buffer, sys.stdout.buffer)
