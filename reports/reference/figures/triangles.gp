# Error on the screen against visible triangles, one curve a renderer.  Draw it again: gnuplot triangles.gp > triangles.svg
set terminal svg size 1120,460 noenhanced font 'sans-serif,15' background '#ffffff' name 'triangles'
set encoding utf8
set datafile missing '?'
set border 3 lc rgb '#777777'
set tics nomirror tc rgb '#333333'
set grid lc rgb '#e6e6e6' lw 1 lt 1
set key at screen 0.5,0.9783 center top horizontal maxrows 1 Left reverse samplen 2 tc rgb '#222222'
set margins screen 0.09643, screen 0.97321, screen 0.15652, screen 0.89565
set xrange [2121.86411:1445614.56]
set yrange [0.170618465:11.592341]
set logscale x
set xtics ('5 000' 5000, '10 000' 10000, '20 000' 20000, '50 000' 50000, '100 000' 100000, '200 000' 200000, '500 000' 500000, '1 000 000' 1000000)
set logscale y
set ytics ('0.2' 0.20000000000000001, '0.5' 0.5, '1' 1, '2' 2, '5' 5, '10' 10)
set xlabel 'visible triangles, mean' offset 0,0.3
set ylabel 'error on the screen, p99.9 (px)'
set arrow from graph 0,first 1 to graph 1,first 1 nohead lc rgb '#999999' lw 1.2
set label 'n=63' at screen 0.27880,0.72403 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'n=127' at screen 0.43272,0.50498 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'n=255' at screen 0.60347,0.40752 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'n=511' at screen 0.78954,0.23032 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'tau=8' at screen 0.16697,0.75491 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=4' at screen 0.28132,0.64141 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=2' at screen 0.36893,0.47683 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=1' at screen 0.51169,0.36142 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=0.5' at screen 0.65429,0.22937 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'rows=150' at screen 0.42111,0.61174 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=210' at screen 0.51091,0.54069 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=300' at screen 0.60625,0.48917 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=424' at screen 0.69887,0.41226 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=600' at screen 0.79195,0.32545 center font 'sans-serif,12' tc rgb '#009E73'
set label 'step=2' at screen 0.95292,0.86750 center font 'sans-serif,12' tc rgb '#CC79A7'
plot 'triangles.dat' index 0 using 1:2 with linespoints lw 2.4 pt 7 ps 1 lc rgb '#0072B2' title 'clipmap', \
  'triangles.dat' index 1 using 1:2 with linespoints lw 2.4 pt 5 ps 1 lc rgb '#D55E00' title 'geomipmap', \
  'triangles.dat' index 2 using 1:2 with linespoints lw 2.4 pt 9 ps 1 lc rgb '#009E73' title 'pgm', \
  'triangles.dat' index 3 using 1:2 with linespoints lw 2.4 pt 13 ps 1 lc rgb '#CC79A7' title 'decimated'
