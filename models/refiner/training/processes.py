"""One process, or several that ``torchrun`` started: they differ in their crops and average their gradients."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
import torch.distributed as distributed
from torch import nn


@dataclass(frozen=True)
class Processes:
    """rank: number of this process. count: of all. device: where it computes."""

    rank: int
    count: int
    device: torch.device

    @property
    def leads(self) -> bool:
        """Whether this one writes files and says what is going on."""
        return self.rank == 0

    def joined(self, network: nn.Module) -> nn.Module:
        """The network whose gradients are averages over all processes."""
        if self.count == 1:
            return network
        devices = [self.device] if self.device.type == "cuda" else None
        return nn.parallel.DistributedDataParallel(network, device_ids=devices)

    def wait(self) -> None:
        if self.count > 1:
            distributed.barrier()


@contextmanager
def training_processes(device: str) -> Iterator[Processes]:
    """The processes of this training, as ``torchrun`` tells in RANK, LOCAL_RANK and WORLD_SIZE."""
    count = int(os.environ.get("WORLD_SIZE", "1"))
    rank = int(os.environ.get("RANK", "0"))
    if device == "cuda":
        device = f"cuda:{os.environ.get('LOCAL_RANK', '0')}"
    chosen = torch.device(device)
    if count == 1:
        yield Processes(0, 1, chosen)
        return
    distributed.init_process_group("nccl" if chosen.type == "cuda" else "gloo", rank=rank, world_size=count)
    try:
        yield Processes(rank, count, chosen)
    finally:
        distributed.destroy_process_group()
