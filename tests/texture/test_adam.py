import torch

from fauna.texture.adam import Adam


def test_steps_are_those_of_torch():
    start = [torch.randn(4, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) for seed in range(3)]
    ours, theirs = ([value.clone().requires_grad_() for value in start] for _ in range(2))
    adam, reference = Adam(ours), torch.optim.Adam(theirs, lr=0.1)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(reference, 20)
    for _ in range(20):
        for values, optimizer in ((ours, adam), (theirs, reference)):
            optimizer.zero_grad()
            ((values[0] - 2.0 * values[1]).square().mean() + values[0].sin().sum()).backward()  # one has no gradient
        adam.step(schedule.get_last_lr()[0])
        reference.step()
        schedule.step()
        for mine, other in zip(ours, theirs, strict=True):
            torch.testing.assert_close(mine, other, rtol=1e-9, atol=1e-12)
    assert torch.equal(ours[2], start[2])
    assert not torch.equal(ours[0], start[0])
