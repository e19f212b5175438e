"""RIST, the classifier of aeon, without the one of its parts that needs a further package."""

from typing import Any

from aeon.classification.hybrid import RISTClassifier
from aeon.transformations.collection import PeriodogramTransformer
from aeon.utils.numba.general import first_order_differences_3d
from sklearn.preprocessing import FunctionTransformer


class ShortRist(RISTClassifier):  # type: ignore[misc]
    """RIST without autoregressive coefficients, for which aeon asks for statsmodels."""

    _tags = {"python_dependencies": None}  # noqa: RUF012  (asked for before a class is made)

    def __init__(self, random_state: int) -> None:
        series = [None, FunctionTransformer(first_order_differences_3d), PeriodogramTransformer()]
        super().__init__(series_transformers=series, random_state=random_state)

    def set_tags(self, **tags: Any) -> Any:  # noqa: ANN401
        """Take all tags but the package that is not needed."""
        return super().set_tags(**{**tags, "python_dependencies": None})
