"""AuxFormer's options and its attention (section 4.2); see ``auxformer``."""

from typing import Literal, Self, cast

from pydantic import Field, model_validator
from torch import Tensor, nn
from torch.nn import functional

from hri_predict.predictors.neural.network import NetworkOptions


class AuxFormerOptions(NetworkOptions):
    """Sizes and switches; the paper's are 96 features (CMU), 8 heads and 3 or 4 layers."""

    features: int = Field(32, ge=4, le=1024, description="F, width of a token")
    heads: int = Field(2, ge=1, le=64, description="heads of each attention; must divide features")
    layers: int = Field(
        3, ge=1, le=32, description="L, layers of observed-only and of full attention each"
    )
    hidden: int = Field(32, ge=1, le=4096, description="units of the FFN after each attention")
    future_stride: int = Field(
        5, ge=1, le=1000, description="future steps per token; the paper's is 1"
    )
    scale: Literal["head", "features"] = Field(
        "head",
        description="width whose 1/sqrt scales attention; features in the paper",
    )
    velocity: bool = Field(False, description="tokens also hold their joint's last step")
    observed_attention: bool = Field(True, description="Table 7: false keeps only full attention")
    order: Literal["iterative", "separate"] = Field(
        "iterative", description="Table 7: separate has all observed-only attention come first"
    )
    masking: bool = Field(True, description="Tables 5 and 6: learn to recover hidden coordinates")
    denoising: bool = Field(True, description="Tables 5 and 6: learn to clean noisy coordinates")
    mask_ratio: float = Field(0.5, ge=0, le=1, description="share of coordinates hidden")
    noise_ratio: float = Field(0.3, ge=0, le=1, description="share of coordinates with noise")
    noise_m: float = Field(
        0.05, ge=0, description="standard deviation of that noise per axis, metres"
    )
    mask_weight: float = Field(1.0, ge=0, description="alpha_1, of the masking loss")
    denoise_weight: float = Field(1.0, ge=0, description="alpha_2, of the denoising loss")
    auxiliary_share: float = Field(
        0.5, gt=0, le=1, description="share of a batch used for the auxiliary tasks; 1 in the paper"
    )
    auxiliary_future: bool = Field(
        False, description="these tasks also have future tokens, and masking predicts the future"
    )

    @model_validator(mode="after")
    def _heads_divide(self) -> Self:
        if self.features % self.heads:
            raise ValueError(f"features ({self.features}) must be a multiple of heads")
        return self


class Attention(nn.Module):
    """Mask-aware attention and FFN with a residual (section 4.2)."""

    def __init__(self, options: AuxFormerOptions, over: Literal["joints", "steps"]) -> None:
        super().__init__()
        features, hidden = options.features, options.hidden
        self.heads, self.over = options.heads, over
        self.scale = features**-0.5 if options.scale == "features" else None
        self.norm = nn.LayerNorm(features)
        self.qkv = nn.Linear(features, 3 * features)
        self.ffn = nn.Sequential(
            nn.Linear(features, hidden), nn.ReLU(inplace=True), nn.Linear(hidden, features)
        )

    def forward(self, tokens: Tensor, observed: Tensor | None) -> Tensor:
        """Update tokens (N, T, J, F) by attention to those that are ``observed`` (N, T, J), or all.

        H <- H + FFN(heads of softmax(Q K' / sqrt(width)) V), the softmax over observed keys.
        """
        q, k, v = self._split(self.qkv(self.norm(tokens)))
        keys = None if observed is None else self._keys(observed)
        mixed = functional.scaled_dot_product_attention(q, k, v, attn_mask=keys, scale=self.scale)
        change = self.ffn(mixed.transpose(1, 2).reshape(tokens.shape))
        if observed is not None:
            change = change * observed[..., None]
        return tokens + change

    def _split(self, x: Tensor) -> tuple[Tensor, ...]:
        """Split (N, T, J, 3 F) into three (sequences, heads, length, F / heads) without a copy.

        Features are ordered by head, then query, key, value, so that joints and heads are one axis.
        """
        n, steps, joints, features = x.shape
        depth = features // (3 * self.heads)
        if self.over == "joints":
            x = x.view(n * steps, joints, self.heads, 3, depth)
        else:
            x = x.view(n, steps, joints * self.heads, 3, depth)
        return x.transpose(1, 2).unbind(3)

    def _keys(self, observed: Tensor) -> Tensor:
        """Key mask for ``_split``; if no key is observed, none is masked (result unused)."""
        if self.over == "joints":
            keys = observed.flatten(0, 1)[:, None, None]
        else:
            keys = observed.transpose(1, 2).repeat_interleave(self.heads, 1)[:, :, None]
        return keys | ~keys.any(-1, keepdim=True)


class Layer(nn.Module):
    """Spatial, then temporal attention."""

    def __init__(self, options: AuxFormerOptions) -> None:
        super().__init__()
        self.spatial = Attention(options, over="joints")
        self.temporal = Attention(options, over="steps")

    def forward(self, tokens: Tensor, observed: Tensor | None) -> Tensor:
        """As ``Attention``."""
        return cast(Tensor, self.temporal(self.spatial(tokens, observed), observed))
