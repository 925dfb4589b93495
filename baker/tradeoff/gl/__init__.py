"""The study's frame and the passes of its methods. Other modules import these only inside functions that draw."""
