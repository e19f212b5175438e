"""Values at the ends of what is accepted: the run succeeds, or ends in one sentence."""

import pytest

TINY = ["debug=tiny", "data.folds=4", "data.classes=3"]
HAPTIC = ["model=haptic", *TINY]
PHOTO = ["model=visual_tcnn", "model.visual.width=0.1", *TINY]
FUSION = ["model=fusion_tcnn", "model.visual.width=0.1", *TINY]
BANDS = ["model=haptic_bands", "data.folds=4"]
FRONTIER = ["task=frontier", "frontier.only=[bands]", "crossval.only=[0,1]", *TINY]
STABILITY = ["task=stability", "stability.systems=[BANDS]", "stability.only=[quieter]", *TINY]
FIT, VISUAL, FUSED = "model.haptic.fit", "model.visual.fit", "model.fusion.fit"

CASES = [
    *[(HAPTIC, each) for each in (
        f"{FIT}.batch_size=1", f"{FIT}.batch_size=512", f"{FIT}.learning_rate=10",
        f"{FIT}.learning_rate=1e-300", f"{FIT}.frames=1", f"{FIT}.frames=20000",
        f"{FIT}.head_factor=1e-300", f"{FIT}.label_smoothing=0.9999",
        f"{FIT}.perturb=[white_noise] {FIT}.perturbed_copies=100", f"{FIT}.optimizer={{}}",
        f"{FIT}.optimizer={{_target_:torch.optim.LBFGS}}",
        f"{FIT}.optimizer={{_target_:torch.optim.SparseAdam}}", f"{FIT}.schedule={{}}",
        f"{FIT}.schedule={{_target_:torch.optim.lr_scheduler.ReduceLROnPlateau}}",
        "model.haptic.width=1e-9", "model.haptic.width=1e-9 model.haptic.norm=lrn",
        "model.haptic.dropout=0.9999999", "model.haptic.window_seconds=10",
        "model.haptic.window_seconds=0.001", "data.val_fold=null", "data.num_workers=2",
        "trainer.precision=bf16-mixed", "trainer.precision=16-mixed", "trainer.precision=64-true",
        "trainer.devices=64", "trainer.num_nodes=1024", "trainer.strategy=fsdp",
        "+trainer.max_epochs=0", "+trainer.limit_train_batches=0", "+trainer.fast_dev_run=true",
        "+trainer.limit_test_batches=0", "+trainer.enable_checkpointing=false",
        "+trainer.barebones=true", "+trainer.max_time=00:00:00:00", "+trainer.logger=false",
        "+trainer.check_val_every_n_epoch=5", "+trainer.min_epochs=100", "+trainer.callbacks=[]",
        "decision.unknown=1e-12", "decision.unknown=0.9999", "explained_samples=1000000",
    )],
    *[(BANDS, each) for each in (
        "data.per_class=1", "data.inverted=true", "data.classes=2 data.folds=2 data.val_fold=null",
        "data.sampling_rate=500", "data.sampling_rate=1000000", "data.file_rate=1",
        "data.hold_out=[alpha,beta]", "data.folds=100000", "decision.reject_below=1",
        "decision.unknown=0.9 data.per_class=1", "decision=sequential decision.confidence=0",
        "decision=sequential decision.confidence_thresholds=[]",
        "logger.tensorboard=false", "callbacks=[]", "model.budget=1000",
        "task=crossval crossval.only=[0,0]",
        "task=crossval data.inverted=true", "model=minirocket model.baseline.kernels=1",
    )],
    *[(PHOTO, each) for each in (
        f"{VISUAL}.patch=1", f"{VISUAL}.batch_size=1", f"{VISUAL}.rotation=180",
        f"{VISUAL}.augmentation={{_target_:torch.nn.Flatten}}", "model.visual.width=1e-9",
        "model.visual.head=[1,1]", "model.visual.fc1_kernel=64", "data.half_scale=false",
        "data.half_scale=false data.resize=32",
    )],
    *[(FUSION, each) for each in (
        f"{FUSED}.modality_dropout=1", f"{FUSED}.batch_size=1", "decision.pairs=1",
        "model.fusion.level=fc3", "decision=sequential decision.pairs=1",
    )],
    *[(FRONTIER, each) for each in (
        "frontier.rounds=1", "data.per_class=1",
        "frontier.senses=[haptic]",
        "data.inverted=true", "crossval.only=[0]", "+frontier.systems.bands=null",
    )],
    *[(STABILITY, each) for each in (
        "stability.only=[]",
        "stability.systems=[BANDS,BANDS]",
    )],
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of Lightning, which a user sees
@pytest.mark.parametrize(("common", "given"), CASES, ids=[case for _, case in CASES])
def test_extremes_run_or_are_refused(common, given, cli, surfaces, bands, tmp_path):
    words = [word.replace("BANDS", str(bands)) for word in [*common, *given.split()]]
    data = ["data=folder", f"data.root={surfaces}", f"hydra.run.dir={tmp_path}"]
    outcome = cli(*words, *data)
    assert "Traceback" not in outcome.err + outcome.out
    assert outcome.status == 0 or (outcome.status == 2 and "Error: " in outcome.err), outcome.err
