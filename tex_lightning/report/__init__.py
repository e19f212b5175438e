"""The output of a run: tables, figures, ``report.html`` and what TensorBoard shows."""
