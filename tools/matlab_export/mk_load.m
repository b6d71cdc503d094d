function runs = mk_load(varargin)
%MK_LOAD  Read logs of mechkit into a struct array.
%   R = MK_LOAD('runs.mat')             what `mechkit export` wrote (MAT version 5)
%   R = MK_LOAD('a.csv', 'b.csv.gz')    the logs themselves
%
%   Fields of each element: name, rig, time [s], signals (a column each: q1, q2, u, ...), units,
%   Y (all columns side by side, time first), Y_names, Y_units, gains, parameters, metadata, model.
%   See also MK_PLOT, MK_COMPARE, MK_MODEL, MK_ANIMATE.
  runs = [];
  for k = 1:nargin
    file = varargin{k};
    if ~isempty(regexp(file, '\.mat$', 'once'))
      more = load_mat(file);
    else
      more = load_csv(file);
    end
    if isempty(runs)
      runs = more;
    else
      runs = [runs, more]; %#ok<AGROW>
    end
  end
end

function runs = load_mat(file)
  head = read_head(file);
  if ~isempty(strfind(head, '7.3')) && exist('OCTAVE_VERSION', 'builtin')
    error('mk_load:version', '%s is of version 7.3, which Octave does not read: export it with --format v5', file);
  end
  content = load(file);
  names = fieldnames(content);
  for k = 1:numel(names)
    value = content.(names{k});
    if isstruct(value) && all(isfield(value, {'time', 'signals', 'Y'}))
      runs = value;
      return
    end
  end
  error('mk_load:content', '%s has no struct array that mechkit export wrote', file);
end

function head = read_head(file)
  fid = fopen(file, 'r');
  if fid < 0
    error('mk_load:file', 'cannot read %s', file);
  end
  head = fread(fid, [1, 116], '*char');
  fclose(fid);
end

function run = load_csv(file)
  if ~isempty(regexp(file, '\.gz$', 'once'))
    folder = tempname();
    mkdir(folder);
    gunzip(file, folder);
    [~, base] = fileparts(file);
    lines = read_lines(fullfile(folder, base));
    delete(fullfile(folder, base));
    rmdir(folder);
  else
    lines = read_lines(file);
  end
  [~, base, ext] = fileparts(file);
  is_meta = strncmp(lines, '#', 1);
  metadata = struct();
  for k = find(is_meta(:)')
    pair = regexp(lines{k}, '^#\s*([^:]+):\s*(.*?)\s*$', 'tokens', 'once');
    if ~isempty(pair)
      field = valid_name(pair{1});
      if ~isfield(metadata, field)
        metadata.(field) = pair{2};
      end
    end
  end
  rows = lines(~is_meta & ~cellfun('isempty', lines));
  names = strtrim(strsplit(rows{1}, ',', 'CollapseDelimiters', false));
  data = parse_rows(rows(2:end), numel(names));
  known = true(1, numel(names));
  for k = find(all(isnan(data), 1))
    known(k) = is_empty_column(rows(2:end), k);
  end
  run = assemble([base ext], names(known), data(:, known), metadata);
end

function answer = is_empty_column(rows, column)
  % Whether there is nothing in it, as against text.
  answer = true;
  for k = 1:numel(rows)
    cells = strsplit(rows{k}, ',', 'CollapseDelimiters', false);
    cell_text = strtrim(cells{min(column, numel(cells))});
    if ~isempty(cell_text) && ~strcmpi(cell_text, 'nan')
      answer = false;
      return
    end
  end
end

function lines = read_lines(file)
  fid = fopen(file, 'r');
  if fid < 0
    error('mk_load:file', 'cannot read %s', file);
  end
  text = fread(fid, [1, Inf], '*char');
  fclose(fid);
  lines = strrep(strsplit(text, char(10), 'CollapseDelimiters', false), char(13), '');
end

function data = parse_rows(rows, columns)
  % Fields that are empty or no numbers become NaN.
  text = strjoin(rows, char(10));
  form = repmat('%f', 1, columns);
  try
    cells = textscan(text, form, 'Delimiter', ',', 'EmptyValue', NaN, 'ReturnOnError', false);
    data = [cells{:}];
  catch
    data = [];
  end
  if size(data, 1) ~= numel(rows)
    data = nan(numel(rows), columns);
    for k = 1:numel(rows)
      cells = strsplit(rows{k}, ',', 'CollapseDelimiters', false);
      n = min(numel(cells), columns);
      data(k, 1:n) = str2double(cells(1:n));
    end
  end
end

function run = assemble(name, names, data, metadata)
  run = struct('name', name, 'rig', '', 'time', data(:, strcmp(names, 't')));
  if isfield(metadata, 'rig')
    run.rig = metadata.rig;
  end
  run.signals = struct();
  run.units = struct();
  units = cell(1, numel(names));
  for k = 1:numel(names)
    units{k} = unit_of(names{k});
    run.signals.(valid_name(names{k})) = data(:, k);
    run.units.(valid_name(names{k})) = units{k};
  end
  run.Y = data;
  run.Y_names = names;
  run.Y_units = units;
  run.gains = [];
  run.parameters = struct();
  if isfield(metadata, 'gains')
    run.gains = sscanf(metadata.gains, '%f')';
  end
  if isfield(metadata, 'parameters')
    pairs = regexp(metadata.parameters, '(\S+)=(\S+)', 'tokens');
    for k = 1:numel(pairs)
      run.parameters.(valid_name(pairs{k}{1})) = str2double(pairs{k}{2});
    end
  end
  run.metadata = metadata;
  run.model = [];
end

function unit = unit_of(name)
  if strcmp(name, 't')
    unit = 's';
  elseif ~isempty(regexp(name, '^q[12]$', 'once'))
    unit = 'rad';
  elseif ~isempty(regexp(name, '^dq[12]$', 'once'))
    unit = 'rad/s';
  elseif ~isempty(regexp(name, '^tau[12]?(_cmd)?$', 'once'))
    unit = 'Nm';
  else
    unit = '';
  end
end

function name = valid_name(name)
  name = regexprep(name, '[^A-Za-z0-9_]', '_');
  if isempty(regexp(name, '^[A-Za-z]', 'once'))
    name = ['x' name];
  end
end
