import pytest

from tex_lightning.distributed.place import Place, follows, started_place

STEP = {
    "SLURM_STEP_NUM_TASKS": "8",
    "SLURM_PROCID": "5",
    "SLURM_LOCALID": "1",
    "SLURM_STEP_NODELIST": "node[07-08]",
    "SLURM_JOB_ID": "123456",
}


def test_torchrun_is_believed():
    place = Place(rank=3, local=1, size=4, address="host", port=29_500)
    assert started_place(place.variables()) == place


def test_the_first_node_of_a_slurm_step_leads():
    assert started_place(STEP) == Place(5, 1, 8, "node07", 18_456)
    given = {**STEP, "MASTER_ADDR": "other", "MASTER_PORT": "1234"}
    assert started_place(given) == Place(5, 1, 8, "other", 1234)


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"LOCAL_RANK": "0"},
        {"SLURM_NTASKS": "8", "SLURM_PROCID": "0", "SLURM_JOB_ID": "1"},  # a batch script
        {**STEP, "SLURM_STEP_NUM_TASKS": "1"},  # a job of a sweep
    ],
)
def test_others_stand_alone(environment):
    assert started_place(environment) is None


def test_only_others_than_rank_zero_follow(monkeypatch):
    assert not follows()
    for rank, expected in ((0, False), (1, True)):
        for name, value in Place(rank, 0, 2, "host", 1).variables().items():
            monkeypatch.setenv(name, value)
        assert follows() == expected
