"""What an evaluation says in the log."""

from gsgi.baker.evaluation.comparison import Comparison
from gsgi.baker.evaluation.held_out import Evaluation, ViewEvaluation
from gsgi.baker.evaluation.summary import summary


def test_an_error_below_the_noise_is_no_number_of_decibels():
    found = Comparison(psnr=12.345, ssim=0.99, flip=0.01, ssim_ceiling=0.995, shown_psnr=41.234)
    exact = Comparison(psnr=100.0, ssim=0.99, flip=0.01, ssim_ceiling=0.995, shown_psnr=45.0)
    (line,) = summary(Evaluation([ViewEvaluation("a", 0.01, exact, found)], None, [], None))
    assert "B: error below the reference's noise, SSIM 0.9900" in line
    assert "frame: PSNR 41.23 dB" in line
