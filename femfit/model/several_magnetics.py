"""What the magnetics of several circuits have in common."""

from femfit.core.arrays import FloatArray
from femfit.core.errors import MissingPartError
from femfit.model.magnetics import Magnetics, MagneticState


def of_one_circuit(instead: str) -> MissingPartError:
    """The refusal of what is written for one current, with what there is instead."""
    return MissingPartError(
        f"This needs a model with one circuit; instead {instead}. Take a drawing with one circuit, for example both "
        "coils in series."
    )


class SeveralMagnetics(Magnetics):
    """A co-energy W'(d, i_1..i_n); distances have the shape (...), currents (..., n) in the order of ``names``."""

    names: tuple[str, ...]

    def force(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """F = -dW'/dd in N, of shape (...)."""
        return self.state(distance, current).force

    def motional_constant(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """dF/di_k = -d(flux linkage_k)/dd in N/A, of shape (..., n)."""
        return self.state(distance, current).motional_constant

    def inductance(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """d(flux linkage_j)/di_k in H, of shape (..., n, n)."""
        return self.state(distance, current).inductance

    def force_gradient(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """dF/dd in N/m, of shape (...)."""
        return self.slopes_of_circuits(distance, current).force_gradient

    def state_of_circuits(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """As ``state``, whose currents have an axis of circuits already."""
        return self.state(distance, currents)

    def coenergy_derivatives(
        self,
        distance: FloatArray,  # noqa: ARG002  the base class's
        current: FloatArray,  # noqa: ARG002
        orders: tuple[tuple[int, int], ...],  # noqa: ARG002
    ) -> list[FloatArray]:
        """Refuse what is written for one current."""
        raise of_one_circuit(f"the model has the circuits {', '.join(self.names)}")

    def _derivatives(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        return self.coenergy_derivatives(distance, current, orders)
