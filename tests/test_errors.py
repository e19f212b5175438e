from tex_lightning.errors import SHOWN, listed, shorten


def test_names_in_messages_are_short_and_few():
    assert shorten("rough") == "rough"
    assert len(shorten("x" * 100_000)) < SHOWN + 50
    assert listed(["a", "b"]) == "a, b"
    assert listed([str(n) for n in range(25)]).endswith("18, 19 and 5 more")
