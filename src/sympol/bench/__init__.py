"""Tables, statistics, searches: what is measured about many trainings."""
