"""The mirror image: sides exchanged, twice the same body, and averaged forecasts symmetric."""

import torch

from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.mirror import Mirror
from hri_predict.predictors.neural.network import BodyFrames, last_pose


def window() -> BodyFrames:
    generator = torch.Generator().manual_seed(1)
    positions = torch.randn(3, 6, len(BODY.joints), 3, generator=generator)
    return BodyFrames(positions, torch.rand(positions.shape[:3], generator=generator) > 0.1)


def test_sides_are_exchanged_and_a_second_time_restored() -> None:
    mirror, positions = Mirror(BODY), window().positions
    image = mirror(positions)
    assert torch.equal(mirror(image), positions)
    left, right = BODY.index("l_wrist"), BODY.index("r_wrist")
    assert torch.equal(image[:, :, left], positions[:, :, right] * torch.tensor([1.0, -1.0, 1.0]))


def test_averaged_forecasts_of_mirror_images_are_mirror_images() -> None:
    mirror, given = Mirror(BODY), window()

    def ahead(window: BodyFrames) -> torch.Tensor:
        seen = window.observed[:, -1:, :, None].to(torch.float32)
        turned = window.positions[:, -1:].roll(1, 2) ** 2  # has no symmetry of its own
        return torch.cat([last_pose(window) + seen, turned], 1)

    image = BodyFrames(mirror(given.positions), given.observed[..., mirror.order])
    torch.testing.assert_close(
        mirror.averaged(ahead, image), mirror(mirror.averaged(ahead, given)), rtol=1e-6, atol=1e-6
    )
    assert not torch.equal(ahead(image), mirror(ahead(given)))
