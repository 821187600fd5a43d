"""Model files, read."""

from pathlib import Path

from fmopt.errors import InputError
from fmopt.task.model import Model, load_model
from fmopt.task.object_model.tree import ObjectTree
from fmopt.task.solid_tree import build_tree
from fmopt.task.toml.source import Place


def model_of(path: Path) -> Model:
    """The model of a file; an `InputError` has every fault."""
    model, faults = load_model(path, Place(str(path)), {})
    if model is None or faults:
        raise InputError(*faults)
    return model


def tree_of(path: Path) -> ObjectTree:
    """The tree of a model file."""
    model = model_of(path)
    return build_tree(model.source, model.file)
