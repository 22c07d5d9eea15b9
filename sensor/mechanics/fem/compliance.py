"""Linear elasticity of the gel by finite elements, and the compliance of its skin.

The elements are trilinear hexahedra. Gels are nearly incompressible, and such elements would lock; so the
volumetric energy is that of each element's mean dilatation, which is equivalent to one pressure per element
(Hughes, "The Finite Element Method", 4.4 and 4.5). Nodes on the skeleton and the rim are fixed.

The skin's compliance follows by static condensation: the layers beneath the skin are eliminated one after
another. With the stiffness K in blocks by layers, S_1 = K_11, S_{k+1} = K_{k+1,k+1} − K_{k+1,k} S_k⁻¹
K_{k,k+1}, and the compliance is the inverse of the last S. Each S is factorised once, and solved for COLUMNS
right-hand sides at a time.
"""

import hashlib
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dpotri
from scipy.sparse import csr_array, diags_array
from skfem import Basis, BilinearForm, ElementHex0, ElementHex1, ElementVector
from skfem.helpers import ddot, div, sym_grad

from fastac.sensor.mechanics.fem.mesh import GelMesh
from fastac.sensor.mechanics.press import FemError
from fastac.store.progress import progress_bar
from fastac.store.steps import Step
from fastac.store.store import open_store

COLUMNS = 512
"""Right-hand sides per triangular solve; bounds the memory."""
FILE = "compliance.npy"


@BilinearForm
def _deviatoric(u, v, _):
    return 2 * ddot(sym_grad(u), sym_grad(v)) - 2 / 3 * div(u) * div(v)


@BilinearForm
def _dilatation(u, pressure, _):
    return div(u) * pressure


def stiffness(mesh: GelMesh, modulus_mpa: float, poisson_ratio: float) -> csr_array:
    """The stiffness matrix of all nodes, fixed ones included, sparse (3·nodes, 3·nodes) in N/mm.

    Rows and columns 3n, 3n + 1, 3n + 2 are x, y, z of node n = (k·ny + j)·nx + i.
    """
    basis = Basis(mesh.mesh, ElementVector(ElementHex1()), intorder=2)
    constant = basis.with_element(ElementHex0())
    shear = modulus_mpa / (2 * (1 + poisson_ratio))
    bulk = modulus_mpa / (3 * (1 - 2 * poisson_ratio))
    change = _dilatation.assemble(basis, constant)
    matrix = (
        shear * _deviatoric.assemble(basis)
        + bulk * change.T @ diags_array(1 / constant.dx.sum(axis=1)) @ change
    )
    order = basis.nodal_dofs.T.ravel()
    return csr_array(matrix.tocsr()[order][:, order])


def free_dofs(mesh: GelMesh) -> np.ndarray:
    """Indices of the free degrees of freedom, (layers, 3·ny'·nx'), layer by layer from the skeleton up.

    ny' = ny − 2 and nx' = nx − 2 are the free nodes of a layer along y and x.
    """
    layers, ny, nx = mesh.nodes_mm.shape[:3]
    nodes = np.arange(layers * ny * nx).reshape(layers, ny, nx)[1:, 1:-1, 1:-1]
    return (3 * nodes[..., None] + np.arange(3)).reshape(layers - 1, -1)


def unit_compliance(mesh: GelMesh, poisson_ratio: float, *, progress: bool = True) -> np.ndarray:
    """The skin's compliance for a Young's modulus of 1 MPa, symmetric (n, n) float64 in mm/N.

    n = 3·ny'·nx': x, y, z of each free node, row by row. Displacements are the compliance times nodal forces;
    for another modulus in MPa, divide by it. Raises FemError where the mesh is too distorted.
    """
    matrix, dofs = stiffness(mesh, 1.0, poisson_ratio), free_dofs(mesh)
    size = dofs.shape[1]
    blocks = range(0, size, COLUMNS)
    condensed = matrix[dofs[0]][:, dofs[0]].toarray()
    total = len(blocks) * (len(dofs) - 1) + 1
    with progress_bar(total=total, desc="compliance", unit="block", enabled=progress) as bar:
        for below, above in pairwise(dofs):
            factor = _factor(condensed)
            coupling = matrix[below][:, above]
            half = np.empty((size, size))
            for start in blocks:
                part = slice(start, start + COLUMNS)
                half[:, part] = solve_triangular(factor, coupling[:, part].toarray(), lower=True)
                bar.update()
            condensed = matrix[above][:, above].toarray() - half.T @ half
        inverse, failed = dpotri(_factor(condensed), lower=1, overwrite_c=1)
        bar.update()
    if failed:
        raise FemError("gel mesh: the skin's stiffness is singular")
    lower = np.tril(inverse, -1)
    return lower + lower.T + np.diag(inverse.diagonal())


def _factor(matrix: np.ndarray) -> np.ndarray:
    try:
        return cholesky(matrix, lower=True)
    except np.linalg.LinAlgError:
        raise FemError("gel mesh: the stiffness is not positive: an element is too distorted") from None


def mesh_digest(mesh: GelMesh) -> str:
    """SHA-256, in hexadecimal, of the nodes' positions."""
    digest = hashlib.sha256(repr(mesh.nodes_mm.shape).encode())
    digest.update(np.ascontiguousarray(mesh.nodes_mm, "<f8").tobytes())
    return digest.hexdigest()


def cached_unit_compliance(
    mesh: GelMesh, poisson_ratio: float, store: Path | str, *, progress: bool = True
) -> np.ndarray:
    """`unit_compliance` as a step of the store in the folder `store`: computed once for each mesh."""
    step = Step(
        "compliance",
        write_unit_compliance,
        {"nodes_sha256": mesh_digest(mesh), "poisson_ratio": poisson_ratio},
        (FILE,),
        {"mesh": mesh, "progress": progress},
    )
    return np.load(open_store(Path(store)).perform(step).path(FILE), allow_pickle=False)


def write_unit_compliance(
    folder: Path, nodes_sha256: str, poisson_ratio: float, *, mesh: GelMesh, progress: bool
) -> None:
    """The step behind `cached_unit_compliance`; `nodes_sha256` stands for `mesh` in the step's key."""
    np.save(folder / FILE, unit_compliance(mesh, poisson_ratio, progress=progress))
