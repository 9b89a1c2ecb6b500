"""The LightningModule: optimises and logs, nothing else. The data flow is in ``model.py``, the terms in ``losses/``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from lightning import LightningModule
from torch import Tensor

from fauna.bank.base import slot_entropy
from fauna.discriminator.adversary import Adversary, MaskPair
from fauna.distributed import average_gradients, everywhere
from fauna.geometry.sparse_extraction import EmptyMeshError
from fauna.losses.objective import Losses, Objective
from fauna.model import FaunaModel
from fauna.random import Draws
from fauna.stages import Stage
from fauna.types import Batch, Reconstruction

PRIOR = ("bank", "shape", "appearance.feature_field")
"""Parts that learn at ``optimizer.prior_lr``: the bank and what the paper calls the prior (SDF and feature field)."""

VIEWPOINT = ("viewpoint.", "mask_embedding.")
"""Parts that settle the viewpoint; their learning rate has a factor of its own, ``schedule.viewpoint_lr``."""


@dataclass(frozen=True)
class OptimizerOptions:
    """Adam settings (Tab. 6 of the paper).

    Attributes:
        prior_lr: learning rate of :data:`PRIOR`.
        lr: of everything else in the model.
        discriminator_lr: of the discriminator.
        betas: of the model's Adam.
        eps: of the model's Adam.
        discriminator_betas: of the discriminator's Adam.
        discriminator_eps: of the discriminator's Adam.
        clip_norm: maximal gradient norm over everything that learns at the step, ``None`` = no clipping.
    """

    prior_lr: float
    lr: float
    discriminator_lr: float
    betas: Sequence[float]
    eps: float
    discriminator_betas: Sequence[float]
    discriminator_eps: float
    clip_norm: float | None


class FaunaSystem(LightningModule):
    """Trains a :class:`FaunaModel`.

    Args:
        model: the generator.
        adversary: discriminator and its rules.
        objective: how loss terms combine.
        optimizer: Adam settings.
        seed: of every random draw.
    """

    def __init__(
        self,
        *,
        model: FaunaModel,
        adversary: Adversary,
        objective: Objective,
        optimizer: OptimizerOptions,
        seed: int,
    ) -> None:
        super().__init__()
        self.automatic_optimization = False
        self.model = model
        self.adversary = adversary
        self.objective = objective
        self.options = optimizer
        self.seed = seed
        self.adversarial = False  # set by the DiscriminatorWindow callback
        self.last_finite = True
        self.latest: dict[str, Tensor] = {}  # what the last step logs, for the progress line

    def training_step(self, batch: Sequence[Batch], batch_idx: int) -> None:
        """One optimiser step over this process's micro-batches (``data.accumulate`` of them)."""
        step, share = self.global_step, 1.0 / (len(batch) * self.trainer.world_size)
        generator, discriminator = self.optimizers()[0], self.optimizers(use_pl_optimizer=False)[1]  # type: ignore[index]
        generator.zero_grad()
        pairs: list[MaskPair] = []
        terms: dict[str, Tensor] = {}
        out = None
        for position, micro in enumerate(batch):
            draws = Draws(self.seed, step, self.global_rank * len(batch) + position)
            try:
                losses, out, pair = self.generator_losses(micro, draws)
            except EmptyMeshError:  # counted and named like a non-finite loss
                terms["total"] = torch.full((), torch.nan, device=self.device)
                break
            self.manual_backward(losses.total * share)
            pairs += [] if pair is None else [pair]
            for name, value in {"total": losses.total, **losses.terms}.items():
                terms[name] = terms.get(name, 0.0) + value.detach() / len(batch)
        self._finish(generator, list(self.model.parameters()), terms["total"])
        if self.adversarial and self.adversary.network is not None:  # on every process, whatever became of its masks
            terms |= self._discriminator_step(discriminator, pairs, share)
        if out is not None:
            self._log_terms(terms, out, step)

    def generator_losses(self, batch: Batch, draws: Draws) -> tuple[Losses, Reconstruction, MaskPair | None]:
        """Forward pass and every loss term of the generator for one micro-batch."""
        stage = self.model.stage
        batch = self.model.with_features(batch)
        out = self.model(batch, draws)
        extra: dict[str, Tensor] = {}
        pair = None
        if stage.weight("eikonal"):
            extra["eikonal"] = self.model.shape.eikonal(out.code.detach(), out.base, draws.generator("eikonal"))
        if self.adversarial and self.adversary.network is not None:
            extra["adversarial"], pair = self.adversary.generator_loss(
                batch, out, self.model.renderer, self.model.camera, draws
            )
        return self.objective(batch, self.model.feature_targets(batch), out, stage, extra), out, pair

    def validation_step(self, batch: Sequence[Batch], batch_idx: int) -> None:
        """Losses and silhouette IoU of photos, each reconstructed on its own as at test time."""
        from fauna.metrics.iou import silhouette_iou

        objective = replace(self.objective, weighting="uniform")
        for photo in map(self.model.with_features, batch):
            out = self.model(photo)
            losses = objective(photo, self.model.feature_targets(photo), out, self.model.stage, {})
            self.log("val/iou", silhouette_iou(out.renders.silhouette, photo.masks).mean(), batch_size=1)
            self.log_dict({f"val/{name}": value for name, value in losses.terms.items()}, batch_size=1)

    def configure_optimizers(self) -> list[torch.optim.Optimizer]:
        """One Adam with three groups for the model, one for the discriminator; each trainable parameter is in exactly one."""
        options = self.options
        rates = {"prior": options.prior_lr, "viewpoint": options.lr, "rest": options.lr}
        parameters = parameter_groups(self.model)
        groups = [
            {"params": parameters[name], "lr": lr, "name": name} for name, lr in rates.items() if parameters[name]
        ]
        optimizers: list[torch.optim.Optimizer] = [
            torch.optim.Adam(
                groups,
                betas=(options.betas[0], options.betas[1]),
                eps=options.eps,
                fused=True,
            )
        ]
        adversary = list(self.adversary.parameters()) or [torch.nn.Parameter(torch.zeros(()))]
        optimizers.append(
            torch.optim.Adam(
                adversary,
                lr=options.discriminator_lr,
                betas=(options.discriminator_betas[0], options.discriminator_betas[1]),
                eps=options.discriminator_eps,
                fused=True,
            )
        )
        for optimizer in optimizers:
            for group in optimizer.param_groups:
                group["initial_lr"] = group["lr"]
        return optimizers

    def set_stage(self, stage: Stage) -> None:
        """Called by the StageScheduler callback before each step."""
        self.model.set_stage(stage)
        for optimizer in self.optimizers(use_pl_optimizer=False) if self._trainer is not None else []:  # type: ignore[union-attr]
            for group in optimizer.param_groups:
                own = stage.viewpoint_lr_scale if group.get("name") == "viewpoint" else 1.0
                group["lr"] = group["initial_lr"] * stage.lr_scale * own

    def on_train_start(self) -> None:
        """The settings of this run hold, not those that a checkpoint was written with."""
        restored = self.optimizers(use_pl_optimizer=False)
        for optimizer, wanted in zip(restored, self.configure_optimizers(), strict=True):  # type: ignore[arg-type]
            for group, given in zip(optimizer.param_groups, wanted.param_groups, strict=True):
                group.update({key: given[key] for key in ("initial_lr", "betas", "eps")})

    def _finish(self, optimizer: Any, parameters: list[torch.nn.Parameter], total: Tensor) -> None:
        """Average, check, clip and step. A non-finite step leaves weights and optimiser state as they were."""
        for group in optimizer.param_groups:
            if group["lr"] == 0.0:  # stands still: its gradients must not shorten the step of all others
                for parameter in group["params"]:
                    parameter.grad = None
        average_gradients(parameters)
        grads = [parameter.grad for parameter in parameters if parameter.grad is not None]
        norm = torch.nn.utils.get_total_norm(grads)
        self.last_finite = everywhere(torch.isfinite(norm.to(total.device) + total.detach()), self.device)
        if not self.last_finite:
            for parameter in parameters:
                parameter.grad = None  # Adam passes over parameters without gradient; the step still counts
        elif self.options.clip_norm is not None:
            torch.nn.utils.clip_grads_with_norm_(parameters, self.options.clip_norm, norm)
        optimizer.step()

    def _discriminator_step(self, optimizer: torch.optim.Optimizer, pairs: list[MaskPair], share: float) -> dict:
        optimizer.zero_grad()
        terms: dict[str, Tensor] = {}
        for pair in pairs:
            losses = self.adversary.discriminator_loss(pair)
            self.manual_backward(losses["discriminator"] * share)
            for name, value in losses.items():
                terms[name] = terms.get(name, 0.0) + value.detach() / len(pairs)
        parameters = list(self.adversary.parameters())
        average_gradients(parameters)
        norm = torch.nn.utils.get_total_norm([p.grad for p in parameters if p.grad is not None])
        if everywhere(torch.isfinite(norm), self.device):
            optimizer.step()
        return terms

    def _log_terms(self, terms: Mapping[str, Tensor], out: Reconstruction, step: int) -> None:
        """Exactly the terms of this step, which ``self.log`` cannot do: it repeats the last value of a term that has ended."""
        if not self.trainer.is_global_zero:
            return
        values = {f"loss/{name}": value for name, value in terms.items()}
        values["model/verts"] = torch.tensor(float(out.base.verts.shape[0]))
        if out.pose is not None:
            values["model/angle_rms"] = out.pose.angles.detach().square().mean().sqrt()
        if out.readout.weights is not None:
            values["bank/entropy"] = slot_entropy(out.readout).detach().mean()
        self.latest = values
        if (step + 1) % self.trainer.log_every_n_steps == 0:  # type: ignore[attr-defined]
            for logger in self.trainer.loggers:
                logger.log_metrics({name: float(value) for name, value in values.items()}, step)


def parameter_groups(model: FaunaModel) -> dict[str, list[torch.nn.Parameter]]:
    """Trainable parameters of the ``prior``, of the ``viewpoint`` network with all it reads, and of the ``rest``."""
    groups: dict[str, list[torch.nn.Parameter]] = {"prior": [], "viewpoint": [], "rest": []}
    for name, parameter in model.named_parameters():
        if parameter.requires_grad:
            part = "prior" if name.startswith(PRIOR) else "viewpoint" if name.startswith(VIEWPOINT) else "rest"
            groups[part].append(parameter)
    return groups
