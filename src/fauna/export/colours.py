"""Colours of the vertices: the cheap look, for animals without a texture."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fauna.model import FaunaModel
from fauna.types import Reconstruction


@torch.no_grad()
def vertex_colours(
    model: FaunaModel, out: Reconstruction, texture_embedding: Float[Tensor, "1 chan"]
) -> Float[np.ndarray, "vert 3"]:
    """Albedo at the vertices of the mesh, sRGB in [0, 1].

    Args:
        model: whose appearance it is.
        out: its reconstruction; gives the canonical points.
        texture_embedding: of the row that is coloured.
    """
    points = out.posed.canonical
    row = torch.zeros(len(points), dtype=torch.int64, device=points.device)
    return model.appearance.albedo(points, texture_embedding, row).double().cpu().numpy()
