"""Arrays by name as a pandas DataFrame, where pandas is installed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gimpmd_schemas.errors import BackendError


def dataframe(columns: Mapping[str, Any]) -> Any:
    """Return a pandas DataFrame with these columns.

    Raises
    ------
    BackendError
        pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise BackendError("to_dataframe needs pandas: pip install pandas") from None
    return pandas.DataFrame(dict(columns))
