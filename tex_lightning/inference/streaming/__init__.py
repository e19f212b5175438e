"""Classification while a recording goes on."""
