"""The next measurement: candidate runs, the predictions of every remaining cause, and which run distinguishes the causes."""
