"""A start after the first compiles nothing, and a start loads only what its verb needs."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

# numba keeps compiled kernels in __pycache__ (or NUMBA_CACHE_DIR); `stats` counts what a process found there.
KERNELS_AT_WORK = """
import importlib, json, pkgutil
import numpy as np
import depthprint, depthprint._kernels
from depthprint import Signature, SignatureBatch, SignatureIndex, StreamDistance, difference_matrix, sparse_code

rng = np.random.default_rng(0)
atoms = rng.standard_normal((16, 8))
atoms /= np.linalg.norm(atoms, axis=1, keepdims=True)
for dtype in (np.float32, np.float64):
    sparse_code(rng.standard_normal((5, 8)).astype(dtype), atoms, n_nonzero=3)
signatures = [Signature(rng.random(4), rng.random((4, 3))) for _ in range(3)]
difference_matrix(SignatureBatch.stack(signatures))
index = SignatureIndex([StreamDistance()])
for signature in signatures:
    index.add([signature])
index.query([signatures[0]])

hits = misses = 0
for module in pkgutil.iter_modules(depthprint._kernels.__path__):
    for value in vars(importlib.import_module(f"depthprint._kernels.{module.name}")).values():
        if hasattr(value, "stats") and hasattr(value, "py_func"):
            hits += sum(value.stats.cache_hits.values())
            misses += sum(value.stats.cache_misses.values())
print(json.dumps([hits, misses]))
"""


def run(*arguments: str) -> str:
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.slow
def test_a_second_start_finds_every_kernel_compiled():
    run("-c", KERNELS_AT_WORK)
    hits, misses = json.loads(run("-c", KERNELS_AT_WORK))
    assert hits > 0
    assert misses == 0


@pytest.mark.parametrize(
    "arguments", [["--version"], ["--help"], ["loops", "--help"], ["evaluate", "loops", "--help"]]
)
def test_the_first_words_of_the_command_line_load_no_computation(arguments):
    code = (
        "import json, sys\n"
        "from depthprint.cli.main import app\n"
        f"try:\n    app({arguments!r})\n"
        "except SystemExit:\n    pass\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    loaded = set(json.loads(run("-c", code).splitlines()[-1]))
    assert "depthprint.cli.loops" in loaded
    assert not {"numba", "scipy", "matplotlib", "cv2", "sklearn", "trimesh"} & loaded


def test_facts_about_the_installation_need_no_kernel():
    code = (
        "import json, sys\n"
        "from depthprint.runs import describe_installation\n"
        "describe_installation()\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    loaded = set(json.loads(run("-c", code).splitlines()[-1]))
    assert not {"numba", "scipy", "matplotlib", "cv2", "sklearn", "trimesh"} & loaded
