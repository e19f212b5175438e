"""``report.html``: one page with all that a run folder says, for any browser, without a network."""
