"""The transformer blocks of KD-Former (section 3.3, Eqs. 6 to 11, and how Eqs. 15 to 25 use them).

As usual since Vaswani et al., each head scales by the square root of its own width; Eq. 6 prints
the embedding's width.
"""

import math

import torch
from torch import Tensor, nn

from hri_predict.predictors.kdformer.scalar_attention import scalar_attention


class Attention(nn.Module):
    """Multi-head attention (Eqs. 6 to 10), self or cross: scaled dot product, heads, projection."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(self, x: Tensor, memory: Tensor, mask: Tensor | None) -> Tensor:
        """Attend from ``x`` (B, Q, W) to ``memory`` (B, K, W) where ``mask`` (B, K) is true."""
        batch, queries, width = x.shape
        q, kv = self.query(x), self.key_value(memory)
        if width == self.heads and mask is None:
            attended: Tensor = self.out(scalar_attention(q, *kv.chunk(2, -1)))
            return attended
        q = q.view(batch, queries, self.heads, -1).transpose(1, 2)
        kv = kv.view(batch, memory.shape[1], 2, self.heads, -1)
        k, v = kv.permute(2, 0, 3, 1, 4).unbind(0)
        # Eq. 6 written out: on a CPU, torch's fused function is slower with heads this narrow.
        score = (q * q.shape[-1] ** -0.5) @ k.transpose(-1, -2)
        if mask is not None:
            score = score.masked_fill(~mask[:, None, None, :], -math.inf)
        y = score.softmax(-1) @ v
        out: Tensor = self.out(y.transpose(1, 2).reshape(batch, queries, width))
        return out


class FeedForward(nn.Module):
    """Two fully connected layers with a nonlinearity between (Eq. 11; GELU)."""

    def __init__(self, width: int, ratio: int, dropout: float) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.layers = nn.Sequential(
            nn.Linear(width, ratio * width),
            nn.GELU(),
            nn.Dropout(dropout),
            nn.Linear(ratio * width, width),
        )

    def forward(self, x: Tensor) -> Tensor:
        """``x`` (..., W) plus the layers' output for it."""
        y: Tensor = x + self.layers(self.norm(x))
        return y


class SelfLayer(nn.Module):
    """Attention within a sequence, then feed forward (Eqs. 15 and 16, 17 and 18, 20 and 21)."""

    def __init__(self, width: int, heads: int, ratio: int, dropout: float) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.attention = Attention(width, heads)
        self.feed_forward = FeedForward(width, ratio, dropout)

    def forward(self, x: Tensor, mask: Tensor | None = None) -> Tensor:
        """Map (B, N, W) to the same shape; ``mask`` (B, N) is true where attention is allowed."""
        z = self.norm(x)
        y: Tensor = self.feed_forward(x + self.attention(z, z, mask))
        return y


class CrossLayer(nn.Module):
    """Attention to one or several memories, added up, then feed forward (Eqs. 22 to 25)."""

    def __init__(
        self, *, width: int, heads: int, ratio: int, dropout: float, memories: int = 1
    ) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.memory_norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(memories))
        self.attentions = nn.ModuleList(Attention(width, heads) for _ in range(memories))
        self.feed_forward = FeedForward(width, ratio, dropout)

    def forward(self, x: Tensor, memories: list[Tensor], mask: Tensor | None) -> Tensor:
        """Map (B, Q, W) to the same shape; each memory is (B, K, W), ``mask`` (B, K) is shared."""
        z = self.norm(x)
        for norm, attention, memory in zip(
            self.memory_norms, self.attentions, memories, strict=True
        ):
            x = x + attention(z, norm(memory), mask)
        y: Tensor = self.feed_forward(x)
        return y


def sinusoid(count: int, width: int) -> Tensor:
    """(count, width) the absolute position embedding of Vaswani et al. (Table 3, PE)."""
    position = torch.arange(count, dtype=torch.float64)[:, None]
    half = (width + 1) // 2
    rate = torch.exp(torch.arange(half, dtype=torch.float64) * (-math.log(10000.0) / half))
    table = torch.stack([(position * rate).sin(), (position * rate).cos()], -1)
    return table.reshape(count, -1)[:, :width].float()


class PositionEmbedding(nn.Module):
    """Position embedding of tokens: learnt, or absolute (Table 3)."""

    table: Tensor

    def __init__(self, count: int, width: int, learnable: bool) -> None:
        super().__init__()
        if learnable:
            self.table = nn.Parameter(torch.randn(count, width) * 0.02)
        else:
            self.register_buffer("table", sinusoid(count, width), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """``x`` (..., count, width) with the embedding added."""
        return x + self.table
