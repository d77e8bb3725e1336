"""Classical policies for the driving tasks: what a learnt one has to beat."""
