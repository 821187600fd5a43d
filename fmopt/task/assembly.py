"""Assemblies: a workcell and its tasks, read from a file, every model with its knowledge base."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from os.path import normpath
from pathlib import Path

from fmopt.errors import Fault, InputError, TaskError
from fmopt.spatial.se3 import Pose
from fmopt.spatial.values import Value
from fmopt.task.model import load_model, overrides_of
from fmopt.task.object_model.command import Answer, CommandLimits, Task, answer, completed
from fmopt.task.object_model.goal import FREE
from fmopt.task.object_model.tree import ObjectTree
from fmopt.task.object_model.workcell import Link, Ref, Workcell
from fmopt.task.solid_tree import build_tree
from fmopt.task.toml import assembly_file as files
from fmopt.task.toml.source import Source, read
from fmopt.task.toml.tables import Reading, checked


@dataclass(frozen=True, eq=False)
class AssemblySequence(Value):
    """A workcell as it is at the beginning, and its tasks by name, in their order."""

    title: str
    source: Source
    workcell: Workcell
    tasks: Mapping[str, Task]


@dataclass(frozen=True, eq=False)
class AssemblyStep(Value):
    """A task of an assembly: its name, the knowledge base's answer, and the workcell after it."""

    name: str
    answer: Answer
    after: Workcell


def is_assembly(path: str | PathLike[str]) -> bool:
    """Whether a file describes a workcell with its tasks, to go by its tables.

    Raises:
        InputError: the file cannot be read or is not TOML.
    """
    return bool({"objects", "tasks"} & set(read(Path(path)).data))


def load_assembly(path: str | PathLike[str]) -> AssemblySequence:
    """The assembly of a file.

    Raises:
        InputError: with every fault of the file and of its models.
    """
    source = read(Path(path))
    reading = Reading.of(source.data)
    file, faults = checked(files.AssemblyFile, source, reading)
    if file is None:
        raise InputError(*faults)
    trees = _trees(source, reading, file)
    try:
        links = tuple(Link(link.kind, _ref(link.one), _ref(link.other)) for link in file.links.values())
        workcell = Workcell(trees, links)
    except TaskError as error:
        raise _fault(source, ("links",), error) from error
    return AssemblySequence(file.title, source, workcell, {name: _task(table) for name, table in file.tasks.items()})


def carried_out(assembly: AssemblySequence) -> Iterable[AssemblyStep]:
    """Every task of the assembly in turn, each answered in the workcell that the one before it left.

    Raises:
        InputError: a task breaks a rule; at its place in the file.
        InterferenceError: the parts overlap at a goal.
    """
    workcell = assembly.workcell
    for name, task in assembly.tasks.items():
        try:
            found = answer(workcell, task)
            workcell = completed(workcell, found)
        except TaskError as error:
            raise _fault(assembly.source, ("tasks", name), error) from error
        yield AssemblyStep(name, found, workcell)


def _trees(source: Source, reading: Reading, file: files.AssemblyFile) -> tuple[ObjectTree, ...]:
    """The object trees; faults of all models are found."""
    trees, faults = [], list[Fault]()
    for name, table in file.objects.items():
        key = ("objects", name)
        overrides, found = overrides_of(source, reading, (*key, "parameters"))
        try:
            path = Path(normpath(source.path.parent / table.model))
            model, more = load_model(path, source.place((*key, "model")), overrides)
            found += more
            if model is not None and not found:
                frame = Pose.from_vector([*table.at, *table.turn])
                # Several objects may be of one model: they go by their names in this file.
                trees.append(replace(build_tree(model.source, model.file), name=name, frame=frame))
        except InputError as error:
            found += error.faults
        faults += found
    if faults:
        raise InputError(*dict.fromkeys(faults))  # faults of a model that several objects name are told once
    return tuple(trees)


def _task(table: files.TaskTable) -> Task:
    wanted = table.specification
    x, y, z, rx, ry, rz = (FREE if value is None else value for value in table.goal)
    specification = CommandLimits(wanted.speed, wanted.contact_force, wanted.torque_limit)
    grasp, goal = Pose.from_vector([*table.grasp.at, *table.grasp.turn]), (x, y, z, rx, ry, rz)
    return Task(_ref(table.moving), _ref(table.fixed), goal, table.attachment, specification, grasp)


def _ref(text: str) -> Ref:
    return Ref(*text.split(".", 1))


def _fault(source: Source, key: tuple[str, ...], error: TaskError) -> InputError:
    return InputError(source.place(key, of_key=True).fault("task-rule", error.message, error.advice))
