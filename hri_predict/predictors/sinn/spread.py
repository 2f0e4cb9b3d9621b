"""The spread of the teachers of a distilled network, stated by the network that learned their mean.

Where networks that were trained alike disagree, all of them are less certain: their spread is an
input of the learned scale (``zones.learned_scale``). One network in their place has no members that
could differ, so it learns to foresee the spread from how each joint moved and how far it will go.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

_UNITS = 32
_STILL_M = 0.01  # a way shorter than this tells nothing more


class Spread(nn.Module):
    """Forecasts the logarithm of the spread from what the start knows, and from each joint's way.

    Args:
        features: features of a joint.
    """

    def __init__(self, features: int) -> None:
        super().__init__()
        self.of_joint = nn.Linear(features, _UNITS)
        self.of_step = nn.Linear(3, _UNITS, bias=False)
        self.out = nn.Linear(_UNITS, 1)

    def forward(self, known: Tensor, last: Tensor, positions: Tensor) -> Tensor:
        """(B, H, J, 1) natural logarithm of the spread per axis, in metres.

        It changes neither the features nor the forecast that it reads: gradients end there.

        Args:
            known: (B, J, features) of each joint's past.
            last: (B, 1, J, 3) m, the pose that the forecast starts from.
            positions: (B, H, J, 3) m, the forecast.
        """
        way = (positions - last).detach().square().sum(-1).add(_STILL_M**2).sqrt()
        steps = torch.arange(1, positions.shape[1] + 1).to(way)
        columns = [way.log(), way.mean(-1, keepdim=True).log().expand_as(way)]
        columns.append(steps.log()[None, :, None].expand_as(way))
        hidden = self.of_joint(known.detach())[:, None] + self.of_step(torch.stack(columns, -1))
        out: Tensor = self.out(F.gelu(hidden))
        return out
