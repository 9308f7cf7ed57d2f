# generated: minimisers

from .dogleg import dogleg as dogleg
from .lbfgs import lbfgs as lbfgs

# end of minimisers
from .minimisers import MINIMISERS as MINIMISERS, Minimiser as Minimiser
from .problems import (
    Accepted as Accepted,
    History as History,
    Jacobian as Jacobian,
    LeastSquares as LeastSquares,
    Linearizable as Linearizable,
    Minimum as Minimum,
    ObjectiveFunction as ObjectiveFunction,
    StopReason as StopReason,
    Watch as Watch,
)
