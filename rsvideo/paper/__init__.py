"""Su & Heidrich, "Rolling Shutter Motion Deblurring" (CVPR 2015), as published, to measure this project's method against.

alternation is Algorithm 1 with the motion update (Sec. 4.2.1), latent_image the latent update (Sec. 4.3, Algorithm 2), tracing the
first trajectory (Sec. 4.2.2), and estimate puts them in the place of the project's own steps, each by itself or both.
"""
