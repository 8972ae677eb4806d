"""Truth: what is recorded beside events, and the layouts of data sets that hold it."""
