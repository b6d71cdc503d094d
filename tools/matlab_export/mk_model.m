function model = mk_model(file)
%MK_MODEL  A model of mechkit as function handles.
%   M = MK_MODEL('rig.ini')     through `mechkit export` (the program must be on the path, or named
%                               by the environment variable MECHKIT)
%   M = MK_MODEL('rig.m')       a function that `mechkit export --model rig.ini --out rig.m` wrote
%
%   M.f(t, x, u)    dx/dt; [dx, y, mass] = M.f(t, x, u) also readings and mass matrix
%   M.ode(command)  for ode45 and its like; command(t) gives the motor's command:
%                       [t, x] = ode45(M.ode(@(t) 1.5 * sin(6 * t)), [0 5], M.state(M.rest, 0))
%   M.state(q, v)   state with joints at q, v and every effect at rest
%   M.joints, M.state_names, M.parameter_names, M.p, M.rest, M.u_max, M.u_to_torque, M.rig
%   M.command_delay, M.sensor_delay [s]: delays are the caller's; MK_SIMULATE applies them.
  [folder, name, ext] = fileparts(file);
  if strcmp(ext, '.ini')
    folder = tempname();
    mkdir(folder);
    name = regexprep(['mk_' name], '[^A-Za-z0-9_]', '_');
    program = getenv('MECHKIT');
    if isempty(program)
      program = 'mechkit';
    end
    call = sprintf('"%s" export --model "%s" --out "%s"', program, file, ...
                   fullfile(folder, [name '.m']));
    [status, said] = system([call ' 2>&1']);
    if status ~= 0
      error('mk_model:export', '%s', strtrim(said));
    end
  end
  if isempty(folder)
    folder = pwd();
  end
  addpath(folder);
  rehash();
  law = str2func(name);
  model = law();
  model.f = @(t, x, u) law(t, x, u, model.p);
  model.ode = @(command) @(t, x) law(t, x, command(t), model.p);
  model.state = @(q, v) law('state', q, v, model.p);
end
