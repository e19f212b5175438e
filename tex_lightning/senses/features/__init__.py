"""Features map a decoded recording to network input; a checkpoint contains these modules."""
