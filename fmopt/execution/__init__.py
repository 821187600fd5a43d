"""Plans carried out in a physics engine, under sampled errors, beside what people do without a plan."""
