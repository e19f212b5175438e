"""The paper's other systems and today's peers, behind one interface to fit and to classify."""
