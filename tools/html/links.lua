-- Links between the Markdown files become links between the pages; what is no page keeps its text only.
local pages = {}
for name in (os.getenv("PAGES") or ""):gmatch("%S+") do
    pages[name] = true
end

function Link(link)
    if link.target:match("^%a+:") or link.target:match("^#") then
        return link
    end
    local name, anchor = link.target:match("([%w%-_]+)%.md(#?.*)$")
    if name == "README" and not link.target:match("/README") then
        name = "index"
    end
    if name and pages[name] then
        link.target = name .. ".html" .. anchor
        return link
    end
    if link.target:match("%.html") then
        return link
    end
    return link.content
end

function Image(image)
    image.src = image.src:gsub("^docs/", "")
    return image
end

-- A wide table scrolls by itself, not the page.
function Table(t)
    return pandoc.Div({ t }, { class = "table" })
end
