# SPDX-License-Identifier: MIT
"""Every public name is described: arguments, shapes, units, errors, source; and is in the reference.

Public are the names of ``dolfinx_contact.__all__``, what its public modules define, and the public
methods and properties of these classes.
"""

import ast
import dataclasses
import inspect
import re
import textwrap
import types
from pathlib import Path

import pytest

import dolfinx_contact as dc
from dolfinx_contact import errors, quadrature

ERRORS = {n for n in dir(errors) if n.endswith("Error")}
# What follows the paper or another publication; its docstring or its module's says which
SOURCED = """ContactPair ContactProblem FixedPoint Proximity SeekDirection Segments Simpson SlaveNormal Smooth
Surface infsup.constant plasticity.J2 solvers.iterative""".split()
# Numbers that have no unit say what they are by one of these words
PURE = re.compile(
    r"\b(as for|coefficient|exponent|first step|fraction|last t|load parameter|longest step|number|"
    r"rate|ratio|times up to|whose first column|shorter|shortest step|strain|tolerance)\b|^of the step$",
)
UNIT = re.compile(r"\[[^\]]+\]|\b(radians|degrees|seconds)\b")
SHAPE = re.compile(r"\((?:[\w +−-]+|\*s),[^()]*\)|shape")


def of_module(module):
    """What a module shows."""
    names = getattr(module, "__all__", None) or [
        n
        for n, v in vars(module).items()
        if not n.startswith("_")
        and getattr(v, "__module__", "") == module.__name__
        and (inspect.isfunction(v) or inspect.isclass(v))
    ]
    return {n: getattr(module, n) for n in names}


def public():
    """All of it, by the name that users write."""
    found = {}
    for name in dc.__all__:
        value = getattr(dc, name)
        if inspect.ismodule(value):
            found.update({f"{name}.{n}": v for n, v in of_module(value).items()})
        else:
            found[name] = value
    found["quadrature.Law"] = quadrature.Law
    for name, value in list(found.items()):
        if not inspect.isclass(value):
            continue
        for n in dir(value):
            owner = next((c for c in value.__mro__ if n in vars(c)), object)
            if n.startswith("_") or not owner.__module__.startswith("dolfinx_contact"):
                continue
            member = inspect.getattr_static(value, n)
            if isinstance(member, (types.FunctionType, classmethod, staticmethod, property)):
                found[f"{name}.{n}"] = member
    return found


PUBLIC = public()


def function(value):
    """The function that takes the arguments; None for a property or a class without one."""
    if isinstance(value, (classmethod, staticmethod)):
        return value.__func__
    if isinstance(value, property):
        return value.fget
    if inspect.isclass(value):
        return value.__init__ if inspect.isfunction(value.__init__) else None
    return value


def text(value):
    return inspect.getdoc(value if inspect.isclass(value) else function(value)) or ""


def sections(value):
    """The docstring in parts: what stands before the sections, and each of these."""
    parts = re.split(r"^(Args|Returns|Raises|Attributes):\n", text(value), flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2]))}


def entries(value, section):
    """Descriptions by name; `a, b: …` describes both."""
    out = {}
    body = textwrap.dedent(sections(value).get(section, ""))
    for names, description in re.findall(
        r"^(\S[^:\n]*): ?((?:.*\n?)(?:^ +.*\n?)*)", body, re.MULTILINE
    ):
        out.update({n.strip().lstrip("*"): description for n in names.split(",")})
    return out


def fields(value):
    """Names of a record's fields, which its docstring has to describe."""
    if not dataclasses.is_dataclass(value):
        return []
    return [f.name for f in dataclasses.fields(value) if not f.name.startswith("_")]


def raised(code, seen=None):
    """Our errors that a function raises, itself or in helpers of this package that it calls."""
    seen = set() if seen is None else seen
    if code in seen or not getattr(code, "__module__", "").startswith("dolfinx_contact"):
        return set()
    seen.add(code)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(code)))
    except (OSError, TypeError):
        return set()  # made by dataclass
    out = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            out |= {getattr(node.exc.func, "id", "")} & ERRORS
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            helper = code.__globals__.get(node.func.id)
            if inspect.isfunction(helper) and helper.__module__ == code.__module__:
                out |= raised(helper, seen)
    return out


ALL = pytest.mark.parametrize("name", PUBLIC)


@ALL
def test_described(name):
    """One sentence at least; it begins with a capital or a formula, and ends with a full stop."""
    first = sections(PUBLIC[name])[""].split("\n\n")[0].strip()
    assert first and first[-1] in ".:)" and not "a" <= first[0] <= "z"


@ALL
def test_arguments(name):
    """Each has its entry, and no entry is without its argument."""
    value = PUBLIC[name]
    if fields(value):
        described = {**entries(value, "Args"), **entries(value, "Attributes")}
        wanted = set(fields(value)) - {"slave"}
    else:
        described = entries(value, "Args")
        code = None if isinstance(value, property) else function(value)
        wanted = set(inspect.signature(code).parameters if code else ()) - {"self", "cls"}
        if issubclass(
            value if inspect.isclass(value) else object, (Exception, quadrature.Protocol)
        ):
            return
    missing = wanted - set(described)
    assert not missing
    if not fields(value):
        assert not set(described) - wanted


@ALL
def test_shapes_and_units(name):
    """Arrays have a shape; floats have a unit, or are said to be pure numbers."""
    value = PUBLIC[name]
    described = {**entries(value, "Args"), **entries(value, "Attributes")}
    code = function(value)
    hints = dict(getattr(code, "__annotations__", {}))
    given = hints.pop("return", "")
    lacking = []
    for argument, hint in hints.items():
        entry, hint = described.get(argument, ""), str(hint)
        if "NDArray" in hint and not (SHAPE.search(entry) or SHAPE.search(text(value))):
            lacking.append(f"{argument}: shape")
        if re.match(r"float\b", hint) and not (UNIT.search(entry) or PURE.search(entry)):
            lacking.append(f"{argument}: unit")
    if "NDArray" in str(given) and not SHAPE.search(text(value)):
        lacking.append("returned: shape")
    assert not lacking


@ALL
def test_errors(name):
    """Those raised are under "Raises"; of a class those of its construction."""
    value = PUBLIC[name]
    codes = [function(value)]
    if inspect.isclass(value):
        codes.append(getattr(value, "__post_init__", None))
    found = set().union(*(raised(code) for code in codes if code is not None))
    if isinstance(value, property):
        return
    assert found <= set(re.findall(r"\w+Error", sections(value).get("Raises", "")))


@pytest.mark.parametrize("name", SOURCED)
def test_source(name):
    """An equation (F…), or a publication with its year."""
    value = PUBLIC[name]
    module = inspect.getmodule(value).__doc__
    assert re.search(r"\(F\d+\)|\b(19|20)\d\d\b", text(value) + module)


def test_reference_is_complete():
    """docs/api.md has every public class and function; methods come with their class."""
    page = (Path(__file__).parent.parent / "docs" / "api.md").read_text()
    listed = set(re.findall(r"auto(?:class|function):: (?:dolfinx_contact\.)?([\w.]+)", page))
    for module in re.findall(r"automodule:: dolfinx_contact\.(\w+)", page):
        listed |= {f"{module}.{n}" for n in of_module(getattr(dc, module))}
    methods = {n for n in PUBLIC if inspect.isclass(PUBLIC.get(n.rpartition(".")[0]))}
    assert set(PUBLIC) - methods == listed
