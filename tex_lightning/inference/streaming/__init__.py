"""Classification of a recording that is still going on."""
