"""The processes that share one training run: a single one, or those that torchrun started."""

import contextlib
import importlib
import os
from dataclasses import dataclass, fields
from types import TracebackType

import torch
from torch import Tensor, distributed

from hri_predict.base.errors import ConfigError, first_line
from hri_predict.lab.training.windows.samples import Samples


@dataclass(frozen=True, slots=True)
class Processes:
    """This process, ``rank`` of ``count``. All draw the same batch; each takes a slice of it."""

    rank: int = 0
    count: int = 1

    @classmethod
    def join(cls) -> "Processes":
        """Join the run that torchrun's environment describes (gloo), or run alone.

        Raises:
            ConfigError: the environment is incomplete, or the other processes cannot be reached.
        """
        if int(os.environ.get("WORLD_SIZE", "1")) == 1:
            return cls()
        # Modules that optimisers import keep the group that exists by then, as a default argument.
        # Its threads would outlive destroy_process_group, and at times abort the ending process.
        importlib.import_module("torch._dynamo")
        try:
            if not distributed.is_initialized():
                distributed.init_process_group("gloo")
        except (ValueError, RuntimeError) as error:
            raise ConfigError(
                f"WORLD_SIZE={os.environ['WORLD_SIZE']}: the processes cannot connect; "
                f"start them with torchrun ({first_line(error)})"
            ) from error
        return cls(distributed.get_rank(), distributed.get_world_size())

    def __enter__(self) -> "Processes":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave together with the other processes, or immediately after an error.

        A process that left early would break the connection of those still communicating.
        """
        if self.count == 1:
            return
        if kind is None:
            with contextlib.suppress(RuntimeError):  # another process failed and reports why
                distributed.barrier()
        distributed.destroy_process_group()

    def add(self, tensors: list[Tensor]) -> None:
        """Replace each tensor, in place, by its sum over all processes."""
        if self.count == 1:
            return
        flat = torch.cat([t.reshape(-1).to("cpu", torch.float64) for t in tensors])
        distributed.all_reduce(flat)
        parts = flat.split([t.numel() for t in tensors])
        for tensor, part in zip(tensors, parts, strict=True):
            tensor.copy_(part.view_as(tensor))

    def same(self, tensors: list[Tensor]) -> None:
        """Replace each tensor, in place, by the first process's."""
        if self.count > 1:
            for tensor in tensors:
                distributed.broadcast(tensor, 0)

    def every(self, tensor: Tensor) -> list[Tensor]:
        """Return the tensor of each process, by rank."""
        if self.count == 1:
            return [tensor]
        found = [torch.empty_like(tensor) for _ in range(self.count)]
        distributed.all_gather(found, tensor)
        return found

    def share(self, batch: Samples) -> tuple[Samples, float]:
        """This process's slice of ``batch`` and its share of the batch's loss.

        Losses are means over the known part of the future. A slice with a larger known part weighs
        more, so that the sum over the processes is the mean of the whole batch.
        """
        if self.count == 1:
            return batch, 1.0
        size = len(batch.actions)
        part = slice(self.rank * size // self.count, (self.rank + 1) * size // self.count)
        whole = {each.name: getattr(batch, each.name) for each in fields(batch)}
        mine = Samples(**{name: v[part] for name, v in whole.items() if v is not None})
        known = float(batch.known.sum())
        return mine, float(mine.known.sum()) / known if known else 1.0 / self.count
