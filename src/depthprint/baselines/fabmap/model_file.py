"""The file of a trained FAB-MAP model: one .npz without pickle, small enough to ship."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.chow_liu import ChowLiuTree
from depthprint.baselines.fabmap.depth_picture import DepthPicture
from depthprint.baselines.fabmap.model import FabMapModel
from depthprint.baselines.fabmap.settings import FabMapSettings
from depthprint.errors import DepthprintError, ModelError
from depthprint.io.archive import DAMAGED, read_archive, write_archive

__all__ = ["load_fabmap", "save_fabmap", "shipped_fabmap_path"]

_FORMAT = "depthprint fabmap"
_VERSION = 1


def shipped_fabmap_path(preset: str) -> Path:
    """Path of the model, trained on simulated worlds, that the package ships for a preset; ModelError without one."""
    path = Path(__file__).parents[2] / "models" / f"fabmap-{preset}.npz"
    if not path.is_file():
        raise ModelError(f"no FAB-MAP model ships for preset {preset!r}; give training data of your own")
    return path


def save_fabmap(model: FabMapModel, picture: DepthPicture, path: Path | str) -> Path:
    """Write a model and how depth becomes its pictures."""
    header = {
        "format": _FORMAT,
        "version": _VERSION,
        "settings": asdict(model.settings),
        "picture": asdict(picture),
    }
    arrays: dict[str, npt.NDArray[Any]] = {
        "centres": np.round(model.centres * 255).astype(np.uint8),
        "parent": model.tree.parent,
        "p": model.tree.p.astype(np.float32),
        "p_given_parent": model.tree.p_given_parent.astype(np.float32),
        "p_given_none": model.tree.p_given_none.astype(np.float32),
        "training": np.concatenate(model.training).astype(np.int32),
        "training_ends": np.cumsum([len(words) for words in model.training]),
    }
    path = Path(path)
    write_archive(path, header, arrays)
    return path


def load_fabmap(path: Path | str) -> tuple[FabMapModel, DepthPicture]:
    """Read what ``save_fabmap`` wrote; anything else raises ModelError naming the file."""
    header, arrays = read_archive(path, "FAB-MAP model", _FORMAT, _VERSION)
    try:
        tree = ChowLiuTree(*(arrays[n] for n in ("parent", "p", "p_given_parent", "p_given_none")))
        training = tuple(np.split(arrays["training"], arrays["training_ends"][:-1]))
        centres = np.asarray(arrays["centres"] / 255, dtype=np.float32)
        return FabMapModel(FabMapSettings(**header["settings"]), centres, tree, training), DepthPicture(
            **header["picture"]
        )
    except (*DAMAGED, DepthprintError) as error:
        raise ModelError(f"{path}: expected a whole FAB-MAP model, got {error}") from error
