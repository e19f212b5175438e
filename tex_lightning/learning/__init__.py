"""Trainings: from the recipe to the checkpoint, by Lightning's steps or by a fit in closed form.

:mod:`.train` runs a training: :mod:`.start` gives the first weights, :mod:`.module` and
:mod:`.trainer` take the steps, and :mod:`.finish` measures what the checkpoint keeps beside the
weights. :mod:`.enrolment` and :mod:`.adaptation` change a trained classifier.
"""
