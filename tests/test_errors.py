import pickle

from tex_lightning.errors import SHOWN, UserError, listed, reason, shorten


def test_names_in_messages_are_short_and_few():
    assert shorten("rough") == "rough"
    assert len(shorten("x" * 100_000)) < SHOWN + 50
    assert listed(["a", "b"]) == "a, b"
    assert listed([str(n) for n in range(25)]).endswith("18, 19 and 5 more")


def test_what_a_library_says_stands_inside_a_sentence():
    assert reason(ValueError("Bad header.\n  No 'data' chunk.")) == "Bad header; No 'data' chunk"
    assert reason(MemoryError()) == "MemoryError"
    assert len(reason("x" * 10_000)) < SHOWN + 50


def test_each_line_of_a_mistake_is_one_whatever_names_hold():
    assert str(UserError("File a\nb.wav is empty; replace it.")) == (
        "File a\\nb.wav is empty; replace it."
    )
    several = UserError("2 files cannot be used:", "- a\nb.wav", "- c\x1b[31m.wav")
    assert str(several).splitlines() == [
        "2 files cannot be used:", "- a\\nb.wav", "- c\\x1b[31m.wav",
    ]  # fmt: skip
    assert str(pickle.loads(pickle.dumps(several))) == str(several)  # from a launcher's process
