"""Sparse matrices of scipy; its stubs say so little of their operations that a checker sees `Any` here."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    Sparse = Any
    sparse: Any
else:
    from scipy import sparse

    Sparse = sparse.csr_array

__all__ = ["Sparse", "sparse"]
