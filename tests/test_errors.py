# SPDX-License-Identifier: MIT
"""Wrong input ends in one clear error on all ranks: it names what was given and how to mend it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI
from problems import (
    MASTER,
    PUNCH_MATERIAL,
    SLAVE,
    constant,
    cube_halves,
    one_mesh,
    punch,
    punch_halves,
    two_meshes,
)

import dolfinx_contact as dc
from dolfinx_contact import compat
from dolfinx_contact.errors import together

COMM = MPI.COMM_WORLD
LAST = COMM.size - 1


def expect(kind, call, *parts):
    """Every rank gets an error of this class (no subclass), and its text holds all the parts and
    ends with the page that helps."""
    with pytest.raises(kind) as caught:
        call()
    assert type(caught.value) is kind
    assert str(caught.value).endswith(f"\nSee {kind.page}")
    assert str(caught.value).count("See docs/") == 1
    for part in parts:
        assert part in str(caught.value), str(caught.value)
    # nobody else got another one, or is still waiting
    assert set(COMM.allgather(type(caught.value).__name__)) == {kind.__name__}


@pytest.fixture(scope="module")
def model():
    return punch(COMM)


@pytest.fixture(scope="module")
def surfaces(model):
    return model.surface(SLAVE), model.surface(MASTER)


# -- surfaces -----------------------------------------------------------------------------------------


def test_unknown_tag(model):
    expect(
        dc.InputError,
        lambda: dc.Surface(model.u, model.tags, [SLAVE, 99]),
        "tag 99",
        "[1, 2, 5, 6]",  # the tags there are
        "Choose among these",
    )


def test_no_tag(model):
    expect(dc.InputError, lambda: dc.Surface(model.u, model.tags, []), "give at least one tag")
    expect(dc.InputError, lambda: dc.Surface(model.u, model.tags, "5"), "'5'", "integer")


def test_scalar_displacement(model):
    u = fem.Function(compat.function_space(model.mesh, ("Lagrange", 1)))
    expect(dc.InputError, lambda: dc.Surface(u, model.tags, SLAVE), "shape ()", "2 components")


def test_displacement_that_is_no_function(model):
    w = ufl.TestFunction(model.u.function_space)
    expect(dc.InputError, lambda: dc.Surface(w, model.tags, SLAVE), "Argument", "Function")


def test_tags_of_cells(model):
    cells = np.arange(model.mesh.topology.index_map(2).size_local, dtype=np.int32)
    tags = dolfinx_mesh.meshtags(model.mesh, 2, cells, np.full(len(cells), SLAVE, dtype=np.int32))
    expect(dc.InputError, lambda: dc.Surface(model.u, tags, SLAVE), "dimension 2", "dimension 1")


def test_empty_surface(model):
    """Tags that mark facets of ghost cells only (where the mesh has any), or nothing at all."""
    mesh = model.mesh
    mesh.topology.create_connectivity(1, 2)
    facets = np.arange(len(mesh.topology.connectivity(1, 2).offsets) - 1, dtype=np.int32)
    cells, links = compat.facet_cells(mesh, facets)
    ghost = facets[(cells >= mesh.topology.index_map(2).size_local) & (links == 1)]
    tags = dolfinx_mesh.meshtags(mesh, 1, ghost, np.full(len(ghost), 4, dtype=np.int32))
    if COMM.allreduce(len(ghost)):
        parts = ("no rank owns", "tags [4]", "at least one exterior facet")
    else:
        parts = ("no facet has the tag 4", "hold []", "tag the facets")
    expect(dc.InputError, lambda: dc.Surface(model.u, tags, 4), *parts)


def test_interior_facets_on_one_rank_only(model):
    """One rank marks a facet between two cells: an error on all."""
    facets = np.array(model.tags.indices[model.tags.values == SLAVE])
    if COMM.rank == LAST:
        model.mesh.topology.create_connectivity(1, 2)
        links = model.mesh.topology.connectivity(1, 2).offsets
        inner = np.flatnonzero(np.diff(links) == 2)[:1].astype(np.int32)
        assert len(inner) == 1
        facets = np.sort(np.concatenate([facets, inner]))
    tags = dolfinx_mesh.meshtags(model.mesh, 1, facets, np.full(len(facets), 8, dtype=np.int32))
    call = lambda: dc.Surface(model.u, tags, 8)  # noqa: E731
    expect(dc.InputError, call, "between two cells", "exterior facets only")


# -- pairs --------------------------------------------------------------------------------------------


def test_no_surface(model, surfaces):
    expect(dc.InputError, lambda: dc.ContactPair(surfaces[0], model.u), "master", "give a Surface")


def test_common_facets(model):
    call = lambda: dc.ContactPair(  # noqa: E731
        model.surface(SLAVE), dc.Surface(model.u, model.tags, [SLAVE, MASTER])
    )
    expect(dc.InputError, call, "facets", "[5]", "[5, 6]", "different tags")


def test_common_facets_on_one_rank_only():
    """The common facets all lie on the last rank."""
    model = punch(COMM, lambda x, n: np.where(x[:, 1] > 0, n - 1, 0))
    slave = model.surface(SLAVE)
    assert COMM.size == 1 or COMM.allgather(len(slave.id))[0] == 0
    master = dc.Surface(model.u, model.tags, [SLAVE, MASTER])
    expect(dc.InputError, lambda: dc.ContactPair(slave, master), "share", "different tags")


def test_different_dimensions(surfaces):
    solid = one_mesh(COMM, cube_halves((1, 1)), PUNCH_MATERIAL)
    call = lambda: dc.ContactPair(surfaces[0], solid.surface(MASTER))  # noqa: E731
    expect(dc.InputError, call, "slave is in 2", "master in 3")


WRONG_OPTIONS = {
    "negative rho_n": (dict(rho_n=-2.5), ("rho_n", "-2.5", "positive")),
    "zero rho_n": (dict(rho_n=0.0), ("rho_n", "0.0", "positive")),
    "infinite rho_n": (dict(rho_n=np.inf), ("rho_n", "inf")),
    "initial_contact": (dict(initial_contact=-0.1), ("initial_contact", "-0.1", "0 or more")),
    "nan initial_contact": (dict(initial_contact=np.nan), ("initial_contact", "nan")),
    "degree 7": (dict(pressure_space=("Lagrange", 7)), ("'Lagrange', 7", '("Lagrange", 1)')),
    "continuous constants": (dict(pressure_space=("Lagrange", 0)), ("'Lagrange', 0", '("DG", 0)')),
    "half a degree": (dict(pressure_space=("Lagrange", 1.5)), ("1.5", '("Lagrange", 1)')),
    "N1curl": (dict(pressure_space=("N1curl", 1)), ("N1curl", '("Lagrange", 1)')),
    "rule": (dict(integration=3), ("integration", "3", "Simpson(n)")),
    "target": (dict(target="closest"), ("target", "'closest'", "Proximity()")),
    "normals": (dict(normals="smooth"), ("normals", "'smooth'", '"facet"')),
    "direction as normal without direction": (
        dict(normals="direction"),
        ("normals", "'direction'", "SeekDirection"),
    ),
    "direction of another space": (
        dict(target=dc.SeekDirection((0, 0, 1))),
        ("(0, 0, 1)", "3 components", "2 dimensions"),
    ),
}


@pytest.mark.parametrize("options, parts", WRONG_OPTIONS.values(), ids=WRONG_OPTIONS.keys())
def test_options_of_a_pair(surfaces, options, parts):
    expect(dc.InputError, lambda: dc.ContactPair(*surfaces, **options), "ContactPair", *parts)


def test_axisymmetric_in_3d():
    solid = one_mesh(COMM, cube_halves((1, 1)), PUNCH_MATERIAL)
    expect(dc.InputError, lambda: solid.pair(axisymmetric=True), "axisymmetric", "two-dimensional")


def test_nodes_without_weight():
    """∫ ψ = 0 at the vertices of a triangle for quadratic pressures."""
    solid = one_mesh(COMM, cube_halves((1, 1), ("tetrahedron",) * 2), PUNCH_MATERIAL)
    options = dict(integration=dc.Nodes(), pressure_space=("Lagrange", 2))
    call = lambda: solid.problem(solid.pair(**options))  # noqa: E731
    expect(dc.InputError, call, "degree 2 on triangles", "Simpson(n)", "degree 1")


WRONG_RULES = {
    "Simpson(-1)": (lambda: dc.Simpson(-1), ("Simpson", "-1", "from 0 to 6")),
    "Simpson(7)": (lambda: dc.Simpson(7), ("Simpson", "7", "from 0 to 6")),
    "Simpson(0.5)": (lambda: dc.Simpson(0.5), ("Simpson", "0.5", "integer")),
    "Gauss(0)": (lambda: dc.Gauss(0), ("Gauss", "0", "from 1 to 20")),
    "Gauss(21)": (lambda: dc.Gauss(21), ("Gauss", "21", "from 1 to 20")),
    "zero": (lambda: dc.SeekDirection((0.0, 0.0)), ("(0.0, 0.0)", "not zero")),
    "short": (lambda: dc.SeekDirection((1.0,)), ("(1.0,)", "2 or 3")),
    "long": (lambda: dc.SeekDirection((1.0, 0, 0, 0)), ("(1.0, 0, 0, 0)", "2 or 3")),
    "nan": (lambda: dc.SeekDirection((np.nan, 1.0)), ("nan", "2 or 3")),
    "radius": (lambda: dc.Proximity(radius=0.0), ("Proximity", "radius", "0.0", "positive")),
    "direction's radius": (
        lambda: dc.SeekDirection((0, 1), radius=-1.0),
        ("SeekDirection", "radius", "-1.0"),
    ),
    "end": (lambda: dc.Proximity(end_tolerance=-0.5), ("end_tolerance", "-0.5", "≥ 0")),
}


@pytest.mark.parametrize("call, parts", WRONG_RULES.values(), ids=WRONG_RULES.keys())
def test_rules_and_targets(call, parts):
    expect(dc.InputError, call, *parts)


# -- problems -----------------------------------------------------------------------------------------


def test_displacement_not_among_the_unknowns(model, surfaces):
    other = fem.Function(model.u.function_space)
    F = ufl.replace(model.F, {model.u: other})
    call = lambda: dc.ContactProblem(F, other, [dc.ContactPair(*surfaces)])  # noqa: E731
    expect(dc.InputError, call, "not among the unknowns", "unknown displacement")


def test_slaves_that_share_nodes(model):
    """The arc in two parts, both of them slaves."""
    master = model.surface(MASTER)
    facets = np.asarray(model.tags.indices)[np.asarray(model.tags.values) == SLAVE]
    middle = dolfinx_mesh.compute_midpoints(model.mesh, 1, facets)
    values = np.where(middle[:, 0] < 0.02, SLAVE, 9).astype(np.int32)
    tags = dolfinx_mesh.meshtags(model.mesh, 1, facets, values)
    pairs = [dc.ContactPair(dc.Surface(model.u, tags, tag), master) for tag in (SLAVE, 9)]
    call = lambda: dc.ContactProblem(model.F, model.u, pairs, bcs=model.bcs)  # noqa: E731
    expect(dc.InputError, call, "[5]", "[9]", "share", "one slave surface")


def test_slaves_that_share_nodes_over_a_rank_boundary():
    """No rank sees both surfaces: each owns the facets on one side of the shared node."""
    split = 0.0137
    model = punch(COMM, lambda x, n: np.where(x[:, 0] < split, 0, n - 1))
    facets = np.asarray(model.tags.indices)[np.asarray(model.tags.values) == SLAVE]
    middle = dolfinx_mesh.compute_midpoints(model.mesh, 1, facets)
    values = np.where(middle[:, 0] < split, SLAVE, 9).astype(np.int32)
    tags = dolfinx_mesh.meshtags(model.mesh, 1, facets, values)
    parts = [dc.Surface(model.u, tags, tag) for tag in (SLAVE, 9)]
    if COMM.size > 1:
        assert not any(all(here) for here in COMM.allgather([len(p.id) > 0 for p in parts]))
    pairs = [dc.ContactPair(part, model.surface(MASTER)) for part in parts]
    call = lambda: dc.ContactProblem(model.F, model.u, pairs, bcs=model.bcs)  # noqa: E731
    expect(dc.InputError, call, "share", "one slave surface")


def test_a_pair_given_twice(model, surfaces):
    pair = dc.ContactPair(*surfaces)
    call = lambda: dc.ContactProblem(model.F, model.u, [pair, pair])  # noqa: E731
    expect(dc.InputError, call, "twice")


def test_lists_of_different_lengths():
    upper, lower = two_meshes(COMM, punch_halves(), PUNCH_MATERIAL)
    pair = dc.ContactPair(upper.surface(SLAVE), lower.surface(MASTER))

    def problem(F, u, J=None):
        return lambda: dc.ContactProblem(F, u, [pair], J=J)

    expect(
        dc.InputError,
        problem([upper.F], [upper.u, lower.u]),
        "1 residuals F for 2 unknowns u",
        "one residual for each",
    )
    expect(dc.InputError, problem([upper.F, lower.F], upper.u), "2 residuals F for 1 unknowns u")
    J = [[ufl.derivative(upper.F, upper.u), None]]
    expect(dc.InputError, problem([upper.F, lower.F], [upper.u, lower.u], J), "J", "2 rows of 2")


def test_no_unknown_or_no_pairs(model):
    expect(dc.InputError, lambda: dc.ContactProblem(model.F, [], []), "u must be")
    for pairs in (None, [model.surface(SLAVE)]):
        expect(
            dc.InputError,
            lambda: dc.ContactProblem(model.F, model.u, pairs),
            "list of ContactPair",
        )
    expect(dc.InputError, lambda: dc.ContactProblem(model.F, "u", []), "dolfinx Function")


# -- while solving ------------------------------------------------------------------------------------


@pytest.mark.parametrize("tag", [SLAVE, MASTER], ids=["slave", "master"])
def test_a_displacement_that_is_not_finite_on_one_rank(tag):
    """A NaN at one node of a surface, on the rank that owns it."""
    model = punch(COMM)
    pair = model.pair()
    problem = model.problem(pair)
    V = model.u.function_space
    facets = model.tags.indices[model.tags.values == tag]
    nodes = fem.locate_dofs_topological(V, 1, facets)
    mine = nodes[nodes < V.dofmap.index_map.size_local]
    first = COMM.allreduce(COMM.rank if len(mine) else COMM.size, op=MPI.MIN)
    if COMM.rank == first:
        model.u.x.array[2 * mine[0]] = np.nan
    before = model.u.x.array.copy()
    expect(dc.ContactError, problem.solve, "not finite", "finite values before solve()")
    # u is given back as it was
    np.testing.assert_array_equal(model.u.x.array, before)
    # and the problem still works
    model.u.x.array[:] = 0
    assert problem.solve().converged


def test_a_step_to_infinity_is_a_failed_solve():
    """A matrix so small that Newton's step overflows: no error of the search, but ConvergenceError,
    which a load-stepping user catches."""
    model = punch(COMM)
    J = constant(model.mesh, 1e-310) * ufl.derivative(model.F, model.u)
    problem = model.problem(model.pair(), J=J)
    expect(dc.ConvergenceError, problem.solve, "did not converge", "NAN", "smaller load step")
    assert not model.u.x.array.any()


def test_together_raises_on_all_or_none():
    with together(COMM, "quiet"):
        pass

    def stage(kind):
        with together(COMM, "stage"):
            if COMM.rank == LAST:
                raise kind("bolts are loose; tighten them")

    expect(dc.InputError, lambda: stage(dc.InputError), "bolts are loose; tighten them")
    expect(dc.ConvergenceError, lambda: stage(dc.ConvergenceError), "bolts are loose")
    # a foreign error stays what it is where it happened, and names its class elsewhere
    with pytest.raises(ZeroDivisionError if COMM.rank == LAST else dc.ContactError) as caught:
        stage(ZeroDivisionError)
    if COMM.rank != LAST:
        assert f"stage: rank {LAST}: ZeroDivisionError" in str(caught.value)
    COMM.barrier()


def test_every_error_has_its_place_on_the_page():
    """The class's own heading of docs/failures.md, from which its anchor is made."""
    kinds = (dc.ContactError, dc.InputError, dc.UnheldError, dc.ConvergenceError)
    text = (Path(__file__).parent.parent / "docs" / "failures.md").read_text()
    for kind in kinds:
        assert kind.page == f"docs/failures.md#{kind.__name__.lower()}"
        assert f"\n## {kind.__name__}\n" in text
        # a message that is passed on, or that another one quotes, names the page once
        assert str(kind(str(kind("quoted")) + "\nand more")).count("See docs/") == 1


# -- complex PETSc ------------------------------------------------------------------------------------

STUB = """
import numpy
class PETSc:
    ScalarType = numpy.complex128
"""

SCRIPT = """
import sys
try:
    import dolfinx_contact
except ImportError as error:
    loaded = [name for name in sys.modules if name.startswith(("dolfinx_contact.", "dolfinx."))]
    print(error, "| loaded:", loaded)
else:
    print("imported")
"""


def test_complex_petsc_is_refused_before_the_extension_loads():
    """The extension is linked to the real PETSc: loading it beside the complex one would crash."""
    # nothing of MPI's environment: the subprocess is not a part of this job
    foreign = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI")
    env = {k: v for k, v in os.environ.items() if not k.startswith(foreign)}
    with tempfile.TemporaryDirectory() as folder:  # pytest's tmp_path is not made for many ranks
        stub = Path(folder) / "petsc4py"
        stub.mkdir()
        (stub / "__init__.py").write_text(STUB)
        env["PYTHONPATH"] = os.pathsep.join([folder, str(Path(dc.__file__).parent.parent)])
        command = [sys.executable, "-c", SCRIPT]
        done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "complex scalars" in done.stdout and "contact needs real ones" in done.stdout
    assert "unset PETSC_DIR" in done.stdout  # how to mend it
    assert "loaded: []" in done.stdout
