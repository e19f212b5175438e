"""Features map a decoded recording to network input; a checkpoint contains these modules.

:mod:`.spectrogram` is what HapticNet reads, and :mod:`.image` what VisualNet reads. Band
proportions (:mod:`.proportions`) take the bands of each window from :mod:`.octave_bands`. Features
of signals begin with the :mod:`.movement` in a recording.
"""
