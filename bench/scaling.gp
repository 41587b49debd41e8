# Time of an iteration against Gaussians and against pixels, by stage, from the CSV file of the benchmark.
set datafile separator ','
set terminal svg size 1060,400 font 'sans-serif,13' background '#ffffff'
set output svg
set multiplot layout 1,2
set logscale xy
set grid lc rgb '#dddddd'
unset key
set ylabel 'milliseconds'
set lmargin at screen 0.07
set rmargin at screen 0.43
set style data linespoints
set linetype 1 lw 3 pt 7 ps 0.6 lc rgb '#222222'
set linetype 2 lw 2 pt 7 ps 0.4 lc rgb '#4477aa'
set linetype 3 lw 2 pt 7 ps 0.4 lc rgb '#66ccee'
set linetype 4 lw 2 pt 7 ps 0.4 lc rgb '#228833'
set linetype 5 lw 2 pt 7 ps 0.4 lc rgb '#ccbb44'
set linetype 6 lw 2 pt 7 ps 0.4 lc rgb '#ee6677'
set linetype 7 lw 2 pt 7 ps 0.4 lc rgb '#aa3377'
stages = "iteration project bin raster loss 'raster backward' update"
set yrange [0.1:400]
set xlabel 'Gaussians, at 800x800 pixels'
set format x '10^{%T}'
plot for [k=1:7] csv using (strcol(1) eq 'gaussians' ? $2 : NaN):(column(k + 4)) notitle
set xlabel 'megapixels, at 100 000 Gaussians'
set format x '%g'
set xtics (0.04, 0.16, 0.64, 2.56)
set key at screen 0.995, screen 0.5 right center reverse Left samplen 2 spacing 1.2
set rmargin at screen 0.82
set lmargin at screen 0.51
plot for [k=1:7] csv using (strcol(1) eq 'pixels' ? $3 * $3 / 1e6 : NaN):(column(k + 4)) title word(stages, k)
