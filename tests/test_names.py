"""Names in natural order."""

from lanelib.names import natural_key


def test_natural_order():
    names = ["test10", "test2", "2", "10", "a2b10", "a2b9", "test", "²"]
    assert sorted(names, key=natural_key) == ["2", "10", "a2b9", "a2b10", "test", "test2", "test10", "²"]
