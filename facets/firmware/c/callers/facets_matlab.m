% Calls the exported solver from MATLAB: `make library` first. Not tried in MATLAB itself.
% loadlibrary needs a C compiler that MATLAB knows (mex -setup C).
here = fileparts(fileparts(mfilename('fullpath')));
if ~libisloaded('facets')
    loadlibrary(fullfile(here, 'libfacets.so'), fullfile(here, 'facets.h'), 'alias', 'facets');
end
reading = libpointer('doublePtr', zeros(1, 9));
calllib('facets', 'facets_readings', [0 0 0.1 0 0 0.001 0 0], reading);
numbers = libpointer('doublePtr', zeros(1, 77));
status = calllib('facets', 'facets_solve_plain', reading.Value, [], 0, numbers);
fprintf('status %d, tz %.6f mm, yaw %.6f mrad\n', status, numbers.Value(3), 1e3 * numbers.Value(6));
unloadlibrary('facets');
