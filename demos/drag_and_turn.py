# SPDX-License-Identifier: MIT
"""A block pressed on a slab, turned about the vertical axis, then dragged: stick and slip in 3D.

The lower face of the block is a cylinder, and so is the upper face of the slab. Their axes cross, so
that the contact is round, as that of a sphere on a plane. Both bodies are neo-Hookean, E = 200,
ν = 0.3, and μ = 0.3. The top of the block moves as a rigid plate:

* down, by 0.06, until t = 0.25;
* about the vertical axis, by 0.08 radians, until t = 0.5. The pressure vanishes at the rim of the
  contact: slip begins there at once and eats its way inwards, while the middle sticks (Lubkin 1951);
* along the axis of the slab, by 0.2, at the same height and angle. Slip now has one direction, and
  friction with it. Its resultant rises to μ times the load, and the moment is lost on the way: a
  contact that slips cannot carry both in full. Who turns a cork to pull it out trades the other way.

Coulomb's law holds as the method has it, in the mean around each node of the slave: friction there
is at most μ times the pressure. Within the facets that the rim crosses single particles can differ,
so that a few of them still count as sticking where their neighbours slip. They carry next to nothing
here, but more on coarser meshes and in shorter steps, unless rho_t is raised: with 8 cells and half
the step, 3.5 % of the load, and friction stays 0.7 % below its full value.

The forces and moments of the plate and of the contact are in balance to Newton's tolerance. Energy is
the judge of the steps: what the plate puts in is what both bodies store and friction dissipates, to
the error of the trapezoidal rule over the steps: below 2 % once the block turns, 0.2 % at the end.

Run it with `python3 demos/drag_and_turn.py`, alone or under mpirun; `--cells` (along the block,
default 12, at least 8) refines the mesh. `--mesh FILE` is a .msh file of two other bodies by Gmsh, one
above the other along z, with physical volumes, and the physical surfaces 5 (slave, the lower face of the
block), 6 (master, the upper face of the slab), 1 (the top of the block) and 2 (the bottom of the slab);
the balance of forces is asserted then, and that friction dissipates. It writes demos/pictures/drag_and_turn.png.
"""

import argparse
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from matplotlib.figure import Figure
from mpi4py import MPI
from petsc4py import PETSc

import dolfinx_contact as dc
from dolfinx_contact import meshes

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--cells", type=int, default=12, help="cells along the block, 8 or more")
parser.add_argument("--mesh", help="a .msh file of both bodies; see above for its groups")
args = parser.parse_args()
n = args.cells

comm = MPI.COMM_WORLD
E, nu, mu, R = 200.0, 0.3, 0.3, 5.0
DOWN, TURN, DRAG = 0.06, 0.08, 0.2
SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2

# -- the meshes ---------------------------------------------------------------------------------------


def block(x):
    """1.6 × 1.6 × 0.6; its lower face is a cylinder along y that touches z = 0."""
    low = R - np.sqrt(R**2 - x[:, 0] ** 2)
    return np.column_stack([x[:, :2], low + x[:, 2] * (0.6 - low)])


def slab(x):
    """2.4 × 1.8 × 0.5; its upper face is a cylinder along x that touches z = 0."""
    high = np.sqrt(R**2 - x[:, 1] ** 2) - R
    return np.column_stack([x[:, :2], high * (1 + x[:, 2]) + 0.5 * x[:, 2]])


layers = max(2, n // 4)
if args.mesh:
    groups = {SLAVE: "slave", MASTER: "master", TOP: "top", BOTTOM: "bottom"}
    mesh, _, facet_tags = meshes.read_msh(comm, args.mesh, 3, facets=groups)
else:
    mesh, body = meshes.create(
        comm,
        [
            meshes.grid((n, n, layers), (-0.8, -0.8, 0), (0.8, 0.8, 1), block, "hexahedron"),
            meshes.grid(
                (round(1.25 * n), n, layers), (-1.1, -0.9, -1), (1.3, 0.9, 0), slab, "hexahedron"
            ),
        ],
    )
    facet_tags = meshes.tag_facets(
        mesh,
        {
            SLAVE: (lambda x: np.isclose(x[2], R - np.sqrt(R**2 - x[0] ** 2)), 0),
            MASTER: (lambda x: np.isclose(x[2], np.sqrt(R**2 - x[1] ** 2) - R), 1),
            TOP: (lambda x: np.isclose(x[2], 0.6), 0),
            BOTTOM: (lambda x: np.isclose(x[2], -0.5), 1),
        },
        body,
    )

# -- the bulk, in UFL: compressible neo-Hookean --------------------------------------------------------

V = dc.vector_space(mesh, 1)
u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
gradient = dc.materials.deformation_gradient(u)
psi = dc.materials.neo_hookean(gradient, *dc.materials.lame(E, nu))
stored = psi * ufl.dx(mesh, metadata={"quadrature_degree": 2})
F = ufl.derivative(stored, u, w)
plate = fem.Function(V)
top = fem.locate_dofs_topological(V, 2, facet_tags.find(TOP))
bcs = [
    fem.dirichletbc(plate, top),
    fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, facet_tags.find(BOTTOM)), V),
]

# -- contact, and the motion of the plate --------------------------------------------------------------

pair = dc.ContactPair(
    dc.Surface(u, facet_tags, SLAVE), dc.Surface(u, facet_tags, MASTER), friction=mu
)
problem = dc.ContactProblem(F, u, [pair], bcs=bcs)


def apply(t):
    """Down up to t = 0.25, turned up to t = 0.5, then dragged."""
    down, turn, drag = (np.clip(s, 0, 1) for s in (4 * t, 4 * t - 1, 2 * t - 1))
    c, s = np.cos(TURN * turn), np.sin(TURN * turn)
    plate.interpolate(
        lambda x: np.array(
            [
                c * x[0] - s * x[1] - x[0] + DRAG * drag,
                s * x[0] + c * x[1] - x[1],
                np.full_like(x[0], -DOWN * down),
            ]
        )
    )


energy_form, reaction_form = fem.form(stored), fem.form(F)
own = top[top < V.dofmap.index_map.size_local]  # nodes of the plate that this rank owns
material = V.tabulate_dof_coordinates()[own]
vectors = lambda f: f.x.array.reshape(-1, 3)[own].copy()  # noqa: E731


def resultants(x, force):
    """Force and vertical moment about the middle of the plate, over all ranks; (4,)."""
    x = x - (DRAG * max(2 * step.time - 1, 0), 0, 0)
    moment = x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    return comm.allreduce(np.append(force.sum(axis=0), moment.sum()))


def coulomb(p):
    """Largest excess of friction over μ times pressure, both in the mean around a node [force]; for
    the demo's own mesh."""
    nodes = np.linspace(-0.8, 0.8, n + 1)
    hats = [np.maximum(1 - np.abs(x[:, None] - nodes) * n / 1.6, 0) for x in p.reference[:, :2].T]
    phi = p.weight[:, None] * (hats[0][:, :, None] * hats[1][:, None, :]).reshape(len(p), -1)
    return np.max(np.linalg.norm(phi.T @ p.friction, axis=1) - mu * phi.T @ p.pressure)


rows, states = [], []
at, reaction, work = np.zeros((len(own), 3)), np.zeros((len(own), 3)), 0.0
for step in dc.LoadStepping(problem, apply, step=0.05, progress=False):
    # the plate's forces on the block, and their work by the trapezoidal rule
    b = petsc.assemble_vector(reaction_form)
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    before, at_before = reaction, at
    reaction, at = b.array_r.reshape(-1, 3)[own], vectors(plate)
    work += comm.allreduce(0.5 * np.sum((reaction + before) * (at - at_before)))
    energy = comm.allreduce(fem.assemble_scalar(energy_form))

    local = pair.particles
    load = resultants(local.position, local.weight[:, None] * local.traction)
    unbalanced = np.abs(load + resultants(material + vectors(u), reaction)).max()
    turning = resultants(local.position, local.weight[:, None] * local.friction)[3]
    dissipated, p = pair.dissipated_energy(), local.gather()
    if comm.rank == 0:
        middle = (DRAG * max(2 * step.time - 1, 0), 0)
        limit = mu * p.weight * p.pressure  # of each particle's friction [force]
        radius = np.linalg.norm(p.position[:, :2] - middle, axis=1)
        power = -p.weight @ np.sum(p.friction * p.slip, axis=1)
        inner, outer = (
            np.average(radius[k], weights=limit[k]) if k.any() else np.nan
            for k in (p.status == "stick", p.status == "slip")
        )
        states.append(p)
        rows.append(
            (
                *(step.time, load[2]),
                np.linalg.norm(p.weight @ p.friction) / limit.sum(),
                -turning / (limit @ radius),
                limit[p.status == "stick"].sum() / limit.sum(),
                power / (limit @ np.linalg.norm(p.slip, axis=1)),
                *(inner, outer, work, energy, dissipated),
                *(unbalanced / load[2], np.nan if args.mesh else coulomb(p) / load[2]),
            )
        )
        print(
            "t = {:.3f}: load {:7.4f}, of full slip: force {:.4f}, moment {:6.4f}, stick {:.4f};"
            " work {:.4f}, error {:7.4f}; ".format(*rows[-1][:5], work, work - energy - dissipated)
            + f"{step.report.iterations} iterations, {step.failed} failed",
            flush=True,
        )

# -- picture and assertions ---------------------------------------------------------------------------

if comm.rank == 0:
    t, load, force, moment, stick, power, *more = np.array(rows).T
    inner, outer, work, stored, lost, unbalanced, excess = more
    figure = Figure(figsize=(14, 8.6), constrained_layout=True)
    panels = figure.subplots(2, 3)
    moments = {"pressed": 0.25, "being turned": 0.4, "dragged a little": 0.6, "all slips": 1.0}
    for axes, (name, time) in zip(panels.ravel()[[0, 1, 3, 4]], moments.items()):
        p = states[np.argmin(np.abs(t - time))]
        dc.plot.status(p, title=f"t = {time}: {name}", axes=axes, plane=(0, 1))
        # one arrow a vertex of the slave that carries friction; those are particles of more facets
        _, k, facets = np.unique(
            np.round(p.reference, 9), axis=0, return_index=True, return_counts=True
        )
        k = k[(facets > 2) & (p.pressure[k] > 0)]
        scale = dict(angles="xy", scale_units="xy", scale=36, width=0.005, zorder=3)
        axes.quiver(*p.position[k, :2].T, *p.friction[k, :2].T, **scale)
        axes.set_aspect("equal")
        if not args.mesh:
            axes.set(xlim=(-0.85, 1.05), ylim=(-0.9, 0.9))
    above, below = panels[:, 2]
    above.plot(t, force, "o-", markersize=3, label="friction force / μ ∫ p")
    above.plot(t, moment, "s-", markersize=3, label="friction moment / μ ∫ p r")
    above.plot(t, stick, ":", color="C0", label="part of the load that sticks")
    above.set(title="Force and moment, of those of full slip", ylim=(-0.05, 1.42))
    below.stackplot(
        t, stored, lost, labels=["stored", "dissipated"], colors=["C2", "C1"], alpha=0.4
    )
    below.plot(t, work, "k.-", label="work of the plate")
    below.set_title("Energy")
    for axes in (above, below):
        for time in (0.25, 0.5):
            axes.axvline(time, color="0.6", linewidth=0.8)
        axes.set_xlabel("t: pressed until 0.25, turned until 0.5, dragged until 1")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=9)
    figure.suptitle(
        "Lower face of the block, from above: points as large as the pressure, arrows for friction"
    )
    file = Path(__file__).parent / "pictures" / "drag_and_turn.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=110)
    print("picture:", file)

    assert unbalanced.max() < 1e-8, "plate and contact: forces and moments"
    assert np.all(np.diff(lost[t > 0.25 - 1e-9]) > 0), "friction dissipates"
if comm.rank == 0 and not args.mesh:
    # to 1e-5 of the load: particles that went to and fro are given a smoothed pressure
    assert excess.max() < 1e-5, "friction is at most μ times the pressure, around every node"
    turn, slide = (t > 0.25 + 1e-9) & (t < 0.5 + 1e-9), t > 0.5 + 1e-9
    assert np.all(inner[turn] < 0.75 * outer[turn]), "the middle sticks, the rim slips"
    assert np.all(np.diff(stick[turn]) < 0) and np.all(stick[turn] > 0.05), "slip goes inwards"
    assert np.all(np.diff(moment[turn]) > 0) and np.all(moment[turn] < 1), "and the moment grows"
    assert moment[turn][-1] > 0.9 and force[turn].max() < 0.01, "there is no force without drag"
    assert np.all(np.diff(force[slide][:5]) > 0) and stick[-1] < 1e-2, "dragged, all slips:"
    assert 0.998 < force[-1] <= 1, "friction has its full value"
    assert moment[-1] < 0.05, "and one direction"
    assert power[-1] > 0.999, "against the slip"
    assert np.all(np.abs(work - stored - lost)[turn | slide] < 0.02 * work[turn | slide])
