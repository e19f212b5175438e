"""Train, test and compare classifiers on the folds of a data set; the tasks are clients of it.

:mod:`.dataset` opens a data set, :mod:`.fold` trains and tests on one fold, and
:mod:`.network_results` tests a checkpoint.
"""
