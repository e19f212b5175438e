"""Values at the ends of what is accepted: the run succeeds, or ends in one sentence."""

import pytest

TINY = ["debug=tiny", "data.folds=4", "data.classes=3"]
HAPTIC = ["model=haptic", *TINY]
PHOTO = ["model=visual_tcnn", "model.visual.width=0.1", *TINY]
FUSION = ["model=fusion_tcnn", "model.visual.width=0.1", *TINY]
BANDS = ["model=band_proportions", "data.folds=4"]
FRONTIER = ["task=frontier", "frontier.only=[band_proportions]", "crossval.only=[0,1]", *TINY]
STABILITY = ["task=stability", "stability.systems=[BANDS]", "stability.only=[quieter]", *TINY]
FIT, VISUAL, FUSED = "model.haptic.fit", "model.visual.fit", "model.fusion.fit"

CASES = [
    *[(HAPTIC, case) for case in (
        f"{FIT}.batch_size=1", f"{FIT}.batch_size=512", f"{FIT}.learning_rate=10",
        f"{FIT}.frames=1", f"{FIT}.frames=20000", f"{FIT}.optimizer={{}}", f"{FIT}.schedule={{}}",
        f"{FIT}.perturb=[white_noise] {FIT}.perturbed_copies=100", f"{FIT}.epochs=0",
        f"{FIT}.optimizer={{_target_:torch.optim.LBFGS}}",
        f"{FIT}.schedule={{_target_:torch.optim.lr_scheduler.ReduceLROnPlateau}}",
        "model.haptic.width=1e-9", "model.haptic.dropout=0.9999999",
        "model.haptic.window_seconds=10", "model.haptic.window_seconds=0.001",
        "data.val_fold=null", "data.num_workers=2", "trainer.precision=16-mixed",
        "trainer.devices=64", "trainer.strategy=fsdp", "+trainer.limit_train_batches=0",
        "+trainer.limit_test_batches=0", "+trainer.enable_checkpointing=false",
        "+trainer.barebones=true", "+trainer.max_time=00:00:00:00",
        "+trainer.check_val_every_n_epoch=5", "decision.unknown=1e-12", "decision.unknown=0.9999",
    )],
    *[(BANDS, case) for case in (
        "data.per_class=1", "data.inverted=true", "data.classes=2 data.folds=2 data.val_fold=null",
        "data.sampling_rate=500", "data.file_rate=20", "data.hold_out=[alpha,beta]",
        "data.folds=100000", "decision.unknown=0.9 data.per_class=1",
        "decision=sequential decision.confidence_threshold=1", "callbacks=[]",
        "task=crossval crossval.only=[0,0]", "task=crossval data.inverted=true",
        "model=minirocket model.baseline.kernels=1",
    )],
    *[(PHOTO, case) for case in (
        f"{VISUAL}.patch=1", f"{VISUAL}.augmentation={{_target_:torch.nn.Flatten}}",
        "model.visual.width=1e-9", "model.visual.head=[1,1]", "model.visual.fc1_kernel=64",
        "data.half_scale=false data.resize=32",
    )],
    *[(FUSION, case) for case in (
        f"{FUSED}.batch_size=1", "decision.pairs=1",
        "model.fusion.level=fc3", "decision=sequential decision.pairs=1",
    )],
    *[(FRONTIER, case) for case in (
        "data.per_class=1", "frontier.senses=[haptic]", "crossval.only=[0]",
        "+frontier.systems.bands=null",
    )],
    *[(STABILITY, case) for case in ("stability.only=[]", "stability.systems=[BANDS,BANDS]")],
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of Lightning, which a user sees
@pytest.mark.parametrize(("task", "given"), CASES, ids=[case for _, case in CASES])
def test_extremes_run_or_are_refused(task, given, cli, surfaces, bands, tmp_path):
    words = [word.replace("BANDS", str(bands)) for word in [*task, *given.split()]]
    data = ["data=folder", f"data.root={surfaces}", f"hydra.run.dir={tmp_path}"]
    outcome = cli(*words, *data)
    assert "Traceback" not in outcome.err + outcome.out
    assert outcome.status == 0 or (outcome.status == 2 and "Error: " in outcome.err), outcome.err
