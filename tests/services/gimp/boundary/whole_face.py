"""A condition on a whole face of a domain of two dimensions."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.face_parts import FacePart

BOX = ((0.0, 16.0), (0.0, 16.0))


def whole_face(axis: int, side: int, **condition) -> FacePart:
    """A face of which all belongs to one condition; the box matters only to parts of faces."""
    return FacePart(axis, side, "boundary", Face(**condition), BOX, np.eye(3))
